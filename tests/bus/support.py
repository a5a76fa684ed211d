"""Devices that misbehave just as a test wants, and an MKS drive on a rig."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.bus.stopping.halt import Halt, Halted
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import write_block
from rs485bus.sim import SimDevice, SimMks, SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import Request

BANK = {register: 100 + register for register in range(64)}


class Scripted(SimUnit):
    """Answers as it is told, once for each entry of `script`; normally when that is used up.

    An entry is "lost" (does it, and its reply is lost), "deaf" (never heard it), a number (answers that many seconds
    late), or a function from the right reply to the one that is sent.
    """

    def __init__(self, address: int, *script: str | float | Callable[[bytes], bytes]) -> None:
        super().__init__(address, BANK)
        self.script = deque(script)
        self.heard: list[bytes] = []

    def receive(self, frame: bytes, now: float) -> bytes | None:
        if frame[0] not in (0, self.address):
            return None
        step = self.script.popleft() if self.script else 0.0
        if step == "deaf":
            return None
        self.heard.append(frame)
        reply = super().receive(frame, now)
        self.turnaround = step if isinstance(step, float) and step else None
        if step == "lost" or reply is None:
            return None
        return step(reply) if callable(step) else reply


class Deaf(SimDevice):
    """A device that is not there."""

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        return None


def outcomes(jobs: Iterable[Job]) -> list[Outcome | None]:
    return [job.outcome for job in jobs]


class Drive:
    """A simulated MKS drive on a rig, attached to its owner."""

    def __init__(self, address: int = 1, **options: object) -> None:
        self.sim = SimMks(address, **options)  # type: ignore[arg-type]
        self.address = address
        self.interruptions: list[str] = []
        self.attached = MksDrive(address)
        self.attached.on_interrupted = self._interrupted
        self.halted: list[Halted] = []

    def _interrupted(self, unheard: float, reason: str) -> None:
        self.interruptions.append(reason)

    def attach(self, rig: Rig) -> None:
        rig.owner.units[self.address].attach(self.attached)

    def start(self, rpm: int = 300, target: int = 10_000_000, code: int = 250) -> Request:
        """The frame of a long move."""
        return write_block(self.address, r.MOVE_TO_COUNTS, code, rpm, target)

    def move(self, rig: Rig, **options: int) -> Job:
        """Set it in motion."""
        return rig.submit(
            self.start(**options), repeat=r.MOVE_TO_COUNTS.repeat, moves=True, motion=self.attached.motion
        )

    def stop(self, rig: Rig, emergency: bool = True) -> Halt:
        """Have the owner stop it."""
        rig.owner.now = rig.now
        halt = rig.owner.stops.halt(rig.owner.units[self.address], self.attached.motion, emergency=emergency)
        halt.listen(self.halted.append)
        return halt


def drives(rig: Rig, count: int, **options: object) -> list[Drive]:
    """So many drives on a rig made without devices."""
    made = [Drive(address, **options) for address in range(1, count + 1)]
    for drive in made:
        rig.pair.devices.append(drive.sim)
        drive.attach(rig)
    return made


def devices_of(rig: Rig) -> list[DeviceAdapter]:
    return [unit.attached for unit in rig.owner.units if unit.attached is not None]
