"""Reading what must be known of a ZLAC8015D, and writing what must be right, at connect and whenever it may have
restarted. Source: ZLAC8015D RS485 V1.06, the section named at each. Pure."""

from __future__ import annotations

import logging
from typing import Any, TypeVar

from rs485bus.bus.watchdog.foreign import OPTION
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.frames import read, write
from rs485bus.devices.zlac.known import KnownZlac
from rs485bus.devices.zlac.known import ZlacSetup as ZlacSetup
from rs485bus.devices.zlac.values import Brake, PowerOnShaft, Side, Synchrony
from rs485bus.errors import MotionError
from rs485bus.motion.plan import Ask, KeepFed, Plan
from rs485bus.wire.frames import payload
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")

_SHIPPED = 1000
"""ms: what its watchdog is set to according to the manual."""
_log = logging.getLogger("rs485bus")
_NEEDED: tuple[Register[Any], ...] = (
    *(r.SYNCHRONY, r.SAVE_WRITES, r.SPEED_LIMIT, r.SPEED_RESOLUTION, r.WATCHDOG),
    *(twin.of(side) for twin in (r.ENCODER_LINES, r.ACCELERATION_TIME, r.DECELERATION_TIME) for side in Side),
)
"""What moves depend on. Where one of them may have changed, the drive is set up again."""


def set_up(drive: KnownZlac) -> Plan[ZlacSetup]:
    """Know what must be known, once until the drive may have changed. What was found, now or before.

    Raises:
        MotionError: the drive cannot be used as it is set.
        WatchdogInfeasible: its watchdog is on and cannot be fed in time.
    """
    if drive.setup is None or any(drive.memory.value(register) is None for register in _NEEDED):
        drive.setup = None
        drive.setup = yield from _set_up(drive)
    return drive.setup


def _set_up(drive: KnownZlac) -> Plan[ZlacSetup]:
    remarks: list[str] = []
    yield from _modes(drive, remarks)
    yield from _speeds(drive, remarks)
    counts = yield from _counts(drive, remarks)
    drive.learn(counts)
    yield Ask(read(drive.address, r.CONTROL_BLOCK))
    *_, left, right = yield from _ask_block(drive, r.TERMINALS)
    for name, brake in (("left", left), ("right", right)):
        if brake is Brake.CLOSED:
            remarks.append(f"the brake of its {name} wheel is closed: open it by set_brakes()")
    watchdog = yield from _watchdog(drive, remarks)
    version = yield from _ask(drive, r.VERSION)
    for remark in remarks:
        _log.warning("%s: %s", drive.name, remark)
    return ZlacSetup(
        version=version,
        counts_per_turn=counts,
        speed_resolution=drive.abilities[0].resolution,
        speed_limit=drive.abilities[0].speed_limit,
        watchdog=watchdog,
        remarks=tuple(remarks),
    )


def _ask(drive: KnownZlac, register: Register[T]) -> Plan[T]:
    return register.decode(payload((yield Ask(read(drive.address, register)))))


def _ask_block(drive: KnownZlac, block: Block) -> Plan[tuple[Any, ...]]:
    return block.decode(payload((yield Ask(read(drive.address, block)))))


def _modes(drive: KnownZlac, remarks: list[str]) -> Plan[None]:
    _, _, _, saves = yield from _ask_block(drive, r.MODES)
    if saves:
        yield Ask(write(drive.address, r.SAVE_WRITES, False))
        remarks.append(
            "it was saving every write to its EEPROM (0x2010), speeds and targets too, which wears that out within "
            "hours. It does not any more; set_parameter(..., save=True) saves what it is to keep"
        )
    if not drive.motion.may_move:
        # Written at every connect: the tables of 3.2 and 4 disagree with its routines about what the values mean.
        yield Ask(write(drive.address, r.SYNCHRONY, Synchrony.ASYNCHRONOUS))


def _speeds(drive: KnownZlac, remarks: list[str]) -> Plan[None]:
    asked = drive.options
    shaft, limit = yield from _ask_block(drive, r.SHAFT_AND_SPEED)
    if shaft is PowerOnShaft.LOCKED:
        remarks.append(
            "after power-on its shafts are locked though not enabled (0x2007). That cannot be told from enabled ones: "
            "a restart may go unnoticed"
        )
    if limit < asked.max_rpm:
        remarks.append(f"its speed limit is {limit} rpm (0x2008), and {asked.max_rpm:g} rpm was asked for")
    resolution = yield from _ask(drive, r.SPEED_RESOLUTION)
    if asked.speed_resolution not in (None, resolution):
        remarks.append(f"its speed resolution was {resolution} (0x2022) and is {asked.speed_resolution} now")
        yield Ask(write(drive.address, r.SPEED_RESOLUTION, asked.speed_resolution))


def _counts(drive: KnownZlac, remarks: list[str]) -> Plan[tuple[int, int]]:
    left = round((yield from _ask(drive, r.ENCODER_LINES.left)))
    right = round((yield from _ask(drive, r.ENCODER_LINES.right)))
    if not left or not right:
        raise MotionError(
            f"{drive.name} says that its encoders have {left} and {right} lines (0x2030, 0x2060). Set what the motors "
            "have: set_parameter(registers.ENCODER_LINES.left, ..., save=True), and right."
        )
    asked = drive.options.encoder_lines
    if asked is not None and (left, right) != (asked, asked):
        remarks.append(
            f"its encoders have {left} and {right} lines (0x2030, 0x2060), and {asked} was asked for. "
            "It counts by what it says, and so do positions"
        )
    return r.COUNTS_PER_LINE * left, r.COUNTS_PER_LINE * right


def _watchdog(drive: KnownZlac, remarks: list[str]) -> Plan[int]:
    """A watchdog that is on is fed from now on, whoever set it: else it would stop every longer move."""
    milliseconds = yield from _ask(drive, r.WATCHDOG)
    if milliseconds == 0:
        remarks.append(
            "its watchdog is off (0x2000): its wheels go on turning when this program or the cable fails. "
            "Move it within `async with bus.watchdog(...)`"
        )
        return milliseconds
    by_somebody = yield KeepFed(milliseconds / 1000)
    if not by_somebody and milliseconds != _SHIPPED:
        remarks.append(
            f"its watchdog is set to {milliseconds} ms (0x2000), perhaps by another program that was killed. It is fed "
            f"from now on; {OPTION} turns it off"
        )
    return milliseconds
