"""How a TL-R drive finds its origin. Source: TL-R manual, 3.4."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.arguments import choice, real
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.drive import TlrDrive
from rs485bus.devices.tlr.frames import control, read
from rs485bus.devices.tlr.values import ControlWord, HomingMode
from rs485bus.errors import (
    DeviceRefused,
    DriveFault,
    HomingFailed,
    LimitExceeded,
    MoveFailed,
    MoveTimeout,
    ReferenceLost,
)
from rs485bus.motion.diagnosis import LOST
from rs485bus.motion.plan import Ask, Ended, Know, Plan, Stand, Start
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import Fact
from rs485bus.wire.frames import payload

_PAUSE = 1.0
"""Seconds for which it may stand where it turns round. One that stands for longer has ended."""
_STILL = 0.3
"""The same before it has come to its switch, where it does not turn round."""
_NOT_ENDED = "its last homing did not find the origin."


@dataclass(frozen=True, slots=True, kw_only=True)
class Homing:
    """How to find the origin.

    With `NEGATIVE_LIMIT` and `POSITIVE_LIMIT` it goes to that limit switch at `rpm`, back off it, and to it again at
    `creep_rpm`. With `POSITIVE_ORIGIN` it does so with the origin switch, from below. With `NEGATIVE_ORIGIN` it goes
    down across the origin switch until that opens again, and up to it at `creep_rpm`. `HERE` is where it stands.
    """

    mode: HomingMode
    rpm: int = 60
    """0..3000."""
    creep_rpm: int = 20
    """0..3000."""
    ramp_ms: int = 100
    """Up to `rpm` and down from it: 0..2000."""
    offset: float = 0.0
    """In units of the axis. Whether it goes there afterwards, or the origin has that position, is up to the drive."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "mode", choice("mode", self.mode, HomingMode))
        real("offset", self.offset)

    def check(self, name: str) -> None:
        """Raise `LimitExceeded` for what is out of range, or never ends."""
        r.HOMING.encode(self.mode, self.rpm, self.creep_rpm, self.ramp_ms, 0)
        if not (self.rpm and self.creep_rpm):
            raise LimitExceeded(f"{name}: it never finds its origin at 0 rpm")

    def values(self, offset: int) -> tuple[int, int, int, int, int]:
        """What the drive is told, with the offset in pulses."""
        return self.mode, self.rpm, self.creep_rpm, self.ramp_ms, offset


def find_origin(drive: TlrDrive, homing: Homing | None, offset: int, timeout: float) -> Plan[None]:
    """Look for the origin.

    Args:
        drive: the drive.
        homing: how; None for what it is set to.
        offset: that of `homing`, in pulses.
        timeout: seconds that it may take.

    Raises:
        HomingFailed: it was not found.
        DriveFault, ReferenceLost: an alarm, or a restart, came between.
    """
    axis = drive.axis
    mode = yield from _mode(drive, homing)
    if homing is not None:
        yield from drive.writer.put(r.HOMING, *homing.values(offset))
    yield from drive.writer.clear_control()
    yield Know((Fact.HOMED, Fact.POSITION), afresh=True)
    search = _Search(drive, mode)
    trusted, axis.lost = axis.lost, axis.lost or _NOT_ENDED
    try:
        yield Start(
            control(drive.address, ControlWord.HOME),
            stop=control(drive.address, ControlWord.STOP),
            stopping=r.MAX_RAMP_MS / 1000,
            signs=(Fact.HOMED,),
            taken=search.has_started,
        )
    except DeviceRefused:
        axis.lost = trusted  # it has not moved
        raise
    try:
        yield Ended(search.has_ended, drive.tells(Fact.HOMED, Fact.MARK), timeout)
    except MoveTimeout as late:
        raise HomingFailed(
            f"{drive.name} has not found its origin within {timeout:g} s and was stopped. Check the switch, the "
            "direction and the speed, or give it longer: home(timeout=...)."
        ) from late
    except DriveFault:
        raise
    except MoveFailed as error:
        raise HomingFailed(str(error)) from error
    if axis.holds is None:
        raise ReferenceLost(f"{drive.name} has restarted during its homing: enable() it, then {LOST}")
    if not search.has_found():
        yield Stand(surely=True)  # it must not start after all once this has been said
        raise HomingFailed(
            f"{drive.name} {'stands without having found its origin' if search.has_started() else 'did not start'}, "
            f"with inputs {axis.last(Fact.INPUTS).value!r}. Check the switch, the direction and the speed."
        )
    if mode is HomingMode.HERE and homing is not None and not offset and abs(axis.value(Fact.POSITION)) > axis.jump:
        raise HomingFailed(
            f"{drive.name} was to be at zero where it stands, and reports {axis.value(Fact.POSITION)} pulses."
        )


def _mode(drive: TlrDrive, homing: Homing | None) -> Plan[HomingMode]:
    """How it will look. Homing by a switch that no input has would never end (3.4.3)."""
    if homing is None:
        mode = r.HOMING_MODE.decode(payload((yield Ask(read(drive.address, r.HOMING_MODE)))))
    else:
        mode = homing.mode
    needed = mode.needs
    functions = yield from drive.input_functions()
    if needed is not None and needed not in functions:
        raise HomingFailed(
            f"{drive.name}: no input has the function {needed.name}, so that homing {mode.name} would never end. "
            f"Nothing was started. Assign it: inputs[0] = DiFunction.{needed.name}."
        )
    return mode


class _Search:
    """One search, judged by what is known of the axis.

    The drive may have been homed before. So that it says so proves nothing as long as it was not seen to take that
    back, unless it stands for long enough.
    """

    def __init__(self, drive: TlrDrive, mode: HomingMode) -> None:
        self._drive = drive
        self._axis = drive.axis
        self._here = mode is HomingMode.HERE
        self._switch = mode.needs
        self._was_homed = self._axis.value(Fact.HOMED)
        self._began_at = self._axis.value(Fact.POSITION)

    def has_started(self) -> bool:
        """Whether something was seen to happen."""
        axis, drive = self._axis, self._drive
        position, homed = axis.value(Fact.POSITION), axis.value(Fact.HOMED)
        moved = position is not None and abs(position - self._began_at) > axis.rule.same
        changed = homed is not None and homed is not self._was_homed
        taken_back = self._was_homed and self._since_start(drive.not_homed_at)
        return moved or changed or taken_back or self._since_start(drive.ran_at)

    def has_found(self) -> bool:
        """Whether it stands, and says that it is homed by this search."""
        if not self._axis.value(Fact.HOMED):
            return False
        fresh = not self._was_homed or self._since_start(self._drive.not_homed_at) or self._stands_long
        return self._here or (fresh and self.has_started())

    def has_ended(self) -> bool | None:
        """Whether it has found what it looked for; None if that cannot be told yet."""
        if self._axis.holds is None:
            return False  # it has restarted
        return True if self.has_found() else False if self._stands_long else None

    @property
    def _stands_long(self) -> bool:
        still, switch = self._axis.standstill, self._switch
        turns_round = switch is None or self._since_start(self._drive.closed_at.get(switch, NEVER))
        return still.unmoved > (_PAUSE if turns_round or not still.has_moved else _STILL)

    def _since_start(self, at: float) -> bool:
        return at >= self._axis.motion.commanded_at
