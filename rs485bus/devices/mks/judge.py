"""How an MKS drive that was stopped is seen to stand. Pure. Source: MKS RTU V1.0.9, 7.2.1."""

from __future__ import annotations

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import Status
from rs485bus.motion.stop_judge import StopJudge
from rs485bus.wire.frames import Request, payload


class MksStopJudge(StopJudge):
    """It tells no speed with its position, and says in its status that it slows down."""

    _says_so = False

    def see(self, request: Request, reply: bytes, sent_at: float) -> bool | None:
        stands = super().see(request, reply, sent_at)
        if request.register == r.STATUS.address:
            self._says_so = r.STATUS.decode(payload(reply)) is Status.SLOWING_DOWN
        self.slows_down = self._says_so
        return stands
