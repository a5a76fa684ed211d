"""What is done to an MKS drive outside of its work. Source: MKS RTU V1.0.9, the section named at each plan."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from rs485bus.arguments import flag
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.alarms import AFTER_CALIBRATION, AFTER_RESTART, STALLED, hints
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import read, write
from rs485bus.devices.mks.values import Boot, PowerOnRun, Status
from rs485bus.errors import DeviceRefused, MotionError, MotorStalled
from rs485bus.motion.plan import AnswersAgain, Ask, Know, MustStand, Plan
from rs485bus.motion.state import Fact
from rs485bus.wire.frames import payload
from rs485bus.wire.registers import Register, Repeat

T = TypeVar("T")


def release_stall(drive: MksDrive) -> Plan[None]:
    """End the state of a stall (3.4.4).

    Raises:
        MotorStalled: it lasts.
    """
    yield Ask(write(drive.address, r.RELEASE_STALL, 1))
    yield Know((Fact.STALLED, Fact.ENABLED))
    if drive.axis.value(Fact.STALLED):
        raise MotorStalled(f"{drive.name} still reports a stall. {hints([STALLED])}")
    drive.axis.holds = drive.axis.value(Fact.ENABLED)


def set_power_on_run(drive: MksDrive, on: bool, while_running: bool) -> Callable[[], Plan[None]]:
    """Whether it runs by itself when it is switched on (8.3). The arguments are checked at once."""
    value = PowerOnRun.SAVE if flag("on", on) else PowerOnRun.CLEAR
    must_stand = not flag("while_running", while_running)

    def plan() -> Plan[None]:
        if must_stand:
            yield MustStand("power-on run")
        yield Ask(write(drive.address, r.POWER_ON_RUN, value))

    return plan


def calibrate(drive: MksDrive, timeout: float) -> Plan[None]:
    """Calibrate the encoder (3.2.1)."""
    yield from _restart(drive, "calibration", r.CALIBRATE, timeout, hints(AFTER_CALIBRATION))


def restart(drive: MksDrive, timeout: float) -> Plan[None]:
    """Start it anew (3.5.2)."""
    yield from _restart(drive, "restart", r.RESTART, timeout, hints(AFTER_RESTART))


def factory_reset(drive: MksDrive, timeout: float) -> Plan[None]:
    """Make all settings those of the factory (3.5.1). It restarts, too."""
    yield from _restart(drive, "factory reset", r.FACTORY_RESET, timeout, hints(AFTER_RESTART))


def enter_boot(drive: MksDrive) -> Plan[None]:
    """Have it wait for firmware (3.6). It answers no Modbus from then on."""
    yield MustStand("boot mode")
    yield from _tell_to_restart(drive, r.BOOT, Boot.ENTER_BOOT)
    drive.axis.lost = "it was restarted."


def silence(drive: MksDrive) -> Plan[None]:
    """Have it answer nothing (3.6)."""
    yield MustStand("silence")
    yield Ask(write(drive.address, r.BOOT, Boot.ENTER_SILENCE))


def wake(drive: MksDrive) -> Plan[None]:
    """Have it answer again (3.6)."""
    yield Ask(write(drive.address, r.BOOT, Boot.LEAVE_SILENCE), insist=True)


def _restart(drive: MksDrive, what: str, register: Register[int], timeout: float, hint: str) -> Plan[None]:
    """Have it restart, and wait until it is there again.

    Raises:
        MotionError: it does not come back.
    """
    yield MustStand(what)
    yield from _tell_to_restart(drive, register, 1)
    if register is r.FACTORY_RESET:
        drive.forget_settings()
    status = read(drive.address, r.STATUS)
    back: bool = yield AnswersAgain(
        status, lambda reply: r.STATUS.decode(payload(reply)) is not Status.CALIBRATING, timeout
    )
    if not back:
        raise MotionError(f"{drive.name} has not come back within {timeout:g} s of its {what}. {hint}")


def _tell_to_restart(drive: MksDrive, register: Register[T], value: T) -> Plan[None]:
    """Once: where the answer is lost, it may have restarted."""
    lost = drive.axis.lost
    try:
        yield Ask(write(drive.address, register, value), repeat=Repeat.NEVER, turns=register is r.CALIBRATE)
    except DeviceRefused:
        drive.axis.lost = lost  # it surely has not
        raise
