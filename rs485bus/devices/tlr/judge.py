"""How a TL-R drive that was stopped is seen to stand. Pure. Source: TL-R manual, 3.5.1."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rs485bus.bus.units.adapter import StandstillDetector
from rs485bus.devices.tlr.telemetry import STILL_RPM, report
from rs485bus.motion.standstill import Standstill, StandstillRule
from rs485bus.wire.frames import Request, payload


class TlrStopJudge(StandstillDetector):
    """It stands if its status says so and its position stays. One reply in which status and speed agree is its status
    alone.

    Args:
        reads: what may be asked, the most telling first.
        rule: how it is seen to stand.
        so_by: the latest time at which what was answered last can have been so.
    """

    def __init__(self, reads: Sequence[Request], rule: StandstillRule, so_by: Callable[[], float]) -> None:
        self._reads = reads
        self._so_by = so_by
        self._still = Standstill(rule)
        self._rpm = 0
        """How fast it was when it was asked last, whichever way it turned."""

    def ask(self, free: Callable[[Request], bool], now: float = 0.0) -> Request | None:
        return next((request for request in self._reads if free(request)), None)

    def see(self, request: Request, reply: bytes, sent_at: float) -> bool | None:
        seen = report(payload(reply))
        before, self._rpm = self._rpm, abs(seen.rpm or 0)
        self.slows_down = seen.rpm is not None and self._rpm < before - STILL_RPM
        self._still.see(sent_at, seen.position, seen.moving, by=self._so_by())
        if seen.moving:
            return False
        stands = seen.position is not None and self._still.verdict is True
        self.by_status_alone = not stands and seen.rpm is not None
        return True if stands or self.by_status_alone else None
