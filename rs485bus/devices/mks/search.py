"""How an MKS drive finds its origin, and goes back to it. Source: MKS RTU V1.0.9, 5."""

from __future__ import annotations

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import write
from rs485bus.devices.mks.homing import Homing, SingleTurnHoming
from rs485bus.devices.mks.values import GoHome, Homed
from rs485bus.errors import HomingFailed, MotorStalled, MoveFailed, MoveTimeout, ReferenceLost
from rs485bus.motion.diagnosis import LOST
from rs485bus.motion.plan import Ended, Know, Plan, Stand, Start
from rs485bus.motion.state import Fact

_SINGLE_TURN, _ORIGIN = 0, 1
"""The halves of 0x3B."""


def find_origin(drive: MksDrive, homing: Homing | None, timeout: float) -> Plan[None]:
    """Look for the origin. None for as the drive is set up.

    Raises:
        HomingFailed: it was not found.
    """
    drive.check_mode()
    if homing is not None:
        yield from drive.prepare_homing(homing)
    half = None if homing is None else _SINGLE_TURN if isinstance(homing, SingleTurnHoming) else _ORIGIN
    before = yield from _seek(drive, GoHome.ORIGIN, timeout, half)
    if not before:
        drive.axis.distrust("its homing ended without an origin.")
        yield Stand(surely=True)
        yield Know((Fact.STALLED,), afresh=True)
        stalled = " It reports a stall." if drive.axis.value(Fact.STALLED) else ""
        raise HomingFailed(
            f"{drive.name} ended its homing without having found the origin.{stalled} Check the switch, the homing "
            "current and what may block the shaft."
        )
    drive.remember_home()


def return_to_zero(drive: MksDrive, timeout: float) -> Plan[None]:
    """Go straight to the coordinate zero.

    Raises:
        ReferenceLost: it is elsewhere, for the drive has restarted.
        MoveFailed: it did not come there.
    """
    drive.check_mode()
    yield from _seek(drive, GoHome.COORDINATE, timeout, None)
    yield Know(drive.marks(0), afresh=True)
    axis = drive.axis
    axis.suspect(drive.restarted(0))
    if axis.lost:
        raise ReferenceLost(f"{drive.name}: {axis.lost} {LOST}")
    if abs(axis.value(Fact.POSITION)) > axis.jump:
        short = f"{drive.name} stands {axis.value(Fact.POSITION)} counts from zero"
        yield Stand(surely=True)  # where something holds its shaft, it would go on when that lets go
        yield Know((Fact.STALLED,), afresh=True)
        if axis.value(Fact.STALLED):
            raise MotorStalled(f"{short}, and reports a stall. {drive.stall_remedy}")
        raise MoveFailed(f"{short}. {drive.what_else(0)}")


def _seek(drive: MksDrive, how: GoHome, timeout: float, half: int | None) -> Plan[bool]:
    """Have the drive look, and see it stand; whether it says that it found what it looked for."""
    axis = drive.axis
    yield Know((Fact.MARK, Fact.POSITION), afresh=True)
    before = axis.value(Fact.MARK)
    yield Start(
        write(drive.address, r.GO_HOME, how),
        stop=write(drive.address, r.EMERGENCY_STOP, 1),  # there is none by a ramp
        stopping=0.0,
        repeat=r.GO_HOME.repeat,  # every write starts it anew (5.3.6)
        signs=(Fact.MARK,),
        taken=lambda: axis.value(Fact.MARK) != before,
    )
    yield Know((Fact.MARK,), afresh=True)
    if half is None and Homed.UNDER_WAY in axis.value(Fact.MARK):
        half = axis.value(Fact.MARK).index(Homed.UNDER_WAY)
    try:
        yield Ended(lambda: None if Homed.UNDER_WAY in axis.value(Fact.MARK) else True, (Fact.MARK,), timeout)
    except MoveTimeout as late:
        axis.distrust("its homing did not end.")
        raise HomingFailed(
            f"{drive.name} has not found its origin within {timeout:g} s and was stopped. Check the switch, the "
            "direction and the speed, or give it longer: home(timeout=...)."
        ) from late
    except MoveFailed as error:
        axis.distrust("its homing was broken off.")
        raise HomingFailed(str(error)) from error
    homed = axis.value(Fact.MARK)
    return Homed.DONE in homed if half is None else homed[half] is Homed.DONE
