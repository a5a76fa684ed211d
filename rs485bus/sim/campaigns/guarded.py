"""Virtual drives that are guarded, on a bus driven by plain calls: what campaigns and tests of watchdogs begin with."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from rs485bus.bus.config import BusConfig
from rs485bus.bus.watchdog.arming import Armed, Arming, admit_watchdogs
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.zlac.drive import ZlacDrive
from rs485bus.errors import WatchdogInfeasible
from rs485bus.sim.device import SimDevice
from rs485bus.sim.mks import SimMks
from rs485bus.sim.rig import Rig
from rs485bus.sim.zlac import SimZlac
from rs485bus.wire.timing import LineSettings

_LONG = 30.0
"""Seconds of a watchdog that is admitted whatever the drives are."""
_NO_ECHO = BusConfig(echo=False)


class Drive:
    """A virtual drive that is guarded, and a witness of how long it was unheard.

    Args:
        address: MKS drives have odd ones.
        turnaround: seconds before it answers.
    """

    def __init__(self, address: int, turnaround: float) -> None:
        self.sim: SimDevice
        adapter: MksDrive | ZlacDrive
        self.turnaround = turnaround
        self.now: Callable[[], float] = lambda: 0.0
        self.told: list[tuple[float, str]] = []
        """When the bus took the drive for tripped, and what it said."""
        self.dead = False
        self.longest = 0.0
        """The longest time for which it was unheard, in seconds."""
        self.heard_at: float | None = None
        if address % 2:
            self.sim, adapter = SimMks(address), MksDrive(address)
        else:
            self.sim, adapter = SimZlac(address, watchdog=0), ZlacDrive(address)
        adapter.on_interrupted = self._interrupted
        self.adapter = adapter
        self._receive = self.sim.receive
        self.sim.receive = self.receive  # type: ignore[method-assign] # this drive stands between

    def receive(self, frame: bytes, now: float) -> bytes | None:
        if self.dead:
            return None
        if frame[0] == self.sim.address:
            self.unheard_until(now)
            self.heard_at = now
        reply = self._receive(frame, now)
        self.sim.turnaround = self.turnaround
        return reply

    def unheard_until(self, now: float) -> float:
        """The longest time for which it was unheard until now."""
        if self.heard_at is not None:
            self.longest = max(self.longest, now - self.heard_at)
        return self.longest

    def _interrupted(self, unheard: float, reason: str) -> None:
        self.told.append((self.now(), reason))


@dataclass(frozen=True, slots=True)
class Plant:
    """What is guarded, and on which line.

    Args:
        count: how many drives, MKS and ZLAC by turns.
        baudrate: bit/s.
        turnarounds: seconds before they answer, by turns.
        config: how the bus behaves.
    """

    count: int
    baudrate: int
    turnarounds: tuple[float, ...]
    config: BusConfig = _NO_ECHO

    def build(self) -> tuple[Rig, list[Drive]]:
        """The bus and its drives."""
        drives = [Drive(at + 1, self.turnarounds[at % len(self.turnarounds)]) for at in range(self.count)]
        rig = Rig(
            *(drive.sim for drive in drives),
            line=LineSettings(baudrate=self.baudrate),
            config=self.config,
            keep_frames=False,
        )
        for drive in drives:
            drive.now = lambda: rig.now
            rig.owner.units[drive.sim.address].attach(drive.adapter)
        return rig, drives

    def tightest(self) -> float:
        """The shortest time, in seconds, that is admitted for all of them."""
        rig, drives = self.build()
        arming = Arming(rig.owner, [drive.adapter for drive in drives], _LONG)
        ended: list[Armed] = []
        rig.owner.start(arming.run(), ended.append)
        rig.run(_LONG, lambda: bool(ended))
        low, high = 1, round(1000 * _LONG)
        while low < high:
            middle = (low + high) // 2
            if self._is_admitted(middle / 1000, arming.turnarounds):
                high = middle
            else:
                low = middle + 1
        return low / 1000

    def _is_admitted(self, timeout: float, turnarounds: dict[int, float]) -> bool:
        rig, drives = self.build()
        try:
            admit_watchdogs(rig.owner, [drive.adapter for drive in drives], timeout, turnarounds)
        except WatchdogInfeasible:
            return False
        return True


def arm(rig: Rig, drives: Iterable[Drive], timeout: float) -> Armed:
    """Arm them as a watchdog block does."""
    ended: list[Armed] = []
    rig.owner.now = rig.now
    rig.owner.start(Arming(rig.owner, [drive.adapter for drive in drives], timeout).run(), ended.append)
    rig.run(60.0, lambda: bool(ended))
    return ended[0]
