"""Reading what must be known of a ZLAC8015D, and writing what must be right, at connect and whenever it may have
restarted. Source: ZLAC8015D RS485 V1.06, the section named at each."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass

from rs485bus.bus.watchdog.foreign import OPTION
from rs485bus.bus.watchdog.guard import admit_and_arm
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.driver import ZlacDriver
from rs485bus.devices.zlac.values import Brake, ControlMode, PowerOnShaft, Side, Synchrony
from rs485bus.errors import MotionError, NoReply, WatchdogInfeasible

_SHIPPED = 1000
"""ms: what its watchdog is set to according to the manual."""
_log = logging.getLogger("rs485bus")


@dataclass(frozen=True, slots=True, kw_only=True)
class ZlacSetup:
    """What was found at connect."""

    version: int
    """Of its software (0x20A0)."""
    counts_per_turn: tuple[int, int]
    """Left and right: four to an encoder line (0x2030, 0x2060)."""
    speed_resolution: int
    """Steps to one rpm (0x2022)."""
    speed_limit: float
    """rpm: the least of what was asked for, 0x2008 and 3000."""
    watchdog: int
    """ms (0x2000); 0 is off."""
    remarks: tuple[str, ...]
    """What differed from what was asked for, or is better known. It was logged, too."""


class SetUp:
    """Sets a drive up, once until it may have restarted.

    Args:
        driver: the drive.
    """

    def __init__(self, driver: ZlacDriver) -> None:
        self._driver = driver
        self._lock = asyncio.Lock()
        self._found: ZlacSetup | None = None

    async def __call__(self) -> ZlacSetup:
        """What was found, now or before.

        Raises:
            MotionError: the drive cannot be used as it is set.
            WatchdogInfeasible: its watchdog is on and cannot be fed in time.
        """
        async with self._lock:
            if self._found is None or not self._driver.known:
                self._found = await self._set_up()
                self._driver.known = True
            return self._found

    async def _set_up(self) -> ZlacSetup:
        driver = self._driver
        remarks: list[str] = []
        async with driver.changing:
            await _modes(driver, remarks)
        await _speeds(driver, remarks)
        driver.counts_per_turn = await _counts(driver, remarks)
        await driver.read_held()
        *_, left, right = await driver.read_block(r.TERMINALS)
        for name, brake in (("left", left), ("right", right)):
            if brake is Brake.CLOSED:
                remarks.append(f"the brake of its {name} wheel is closed: open it by set_brakes()")
        watchdog = await _watchdog(driver, remarks)
        version = await driver.read(r.VERSION)
        for remark in remarks:
            _log.warning("%s: %s", driver.name, remark)
        return ZlacSetup(
            version=version,
            counts_per_turn=driver.counts_per_turn,
            speed_resolution=driver.speed_resolution,
            speed_limit=driver.speed_limit,
            watchdog=watchdog,
            remarks=tuple(remarks),
        )


async def _modes(driver: ZlacDriver, remarks: list[str]) -> None:
    mode, _, synchrony, saves = await driver.read_block(r.MODES)
    if mode is ControlMode.UNDEFINED and driver.attached.mode not in (None, ControlMode.UNDEFINED):
        driver.restarted()  # after power-on it is in no mode, and nothing here takes it out of one
    driver.attached.mode = mode
    if saves:
        await driver.write(r.SAVE_WRITES, False)
        remarks.append(
            "it was saving every write to its EEPROM (0x2010), speeds and targets too, which wears that out within "
            "hours. It does not any more; set_parameter(..., save=True) saves what it is to keep"
        )
    if not driver.attached.motion.may_move:
        # Written at every connect: the tables of 3.2 and 4 disagree with its routines about what the values mean.
        synchrony = Synchrony.ASYNCHRONOUS
        await driver.write(r.SYNCHRONY, synchrony)
    driver.synchrony = synchrony


async def _speeds(driver: ZlacDriver, remarks: list[str]) -> None:
    asked = driver.options
    shaft, limit = await driver.read_block(r.SHAFT_AND_SPEED)
    if shaft is PowerOnShaft.LOCKED:
        remarks.append(
            "after power-on its shafts are locked though not enabled (0x2007). That cannot be told from enabled ones: "
            "a restart may go unnoticed"
        )
    if limit < asked.max_rpm:
        remarks.append(f"its speed limit is {limit} rpm (0x2008), and {asked.max_rpm:g} rpm was asked for")
    driver.speed_limit = float(min(limit, asked.max_rpm, r.MAX_RPM))
    resolution = await driver.read(r.SPEED_RESOLUTION)
    if asked.speed_resolution not in (None, resolution):
        remarks.append(f"its speed resolution was {resolution} (0x2022) and is {asked.speed_resolution} now")
        resolution = asked.speed_resolution
        await driver.write(r.SPEED_RESOLUTION, resolution)
    driver.speed_resolution = resolution


async def _counts(driver: ZlacDriver, remarks: list[str]) -> tuple[int, int]:
    lines = [await driver.read(r.ENCODER_LINES.of(side)) for side in Side]
    left, right = round(lines[0]), round(lines[1])
    if not left or not right:
        raise MotionError(
            f"{driver.name} says that its encoders have {left} and {right} lines (0x2030, 0x2060). Set what the motors "
            "have: set_parameter(registers.ENCODER_LINES.left, ..., save=True), and right."
        )
    asked = driver.options.encoder_lines
    if asked is not None and (left, right) != (asked, asked):
        remarks.append(
            f"its encoders have {left} and {right} lines (0x2030, 0x2060), and {asked} was asked for. "
            "It counts by what it says, and so do positions"
        )
    return r.COUNTS_PER_LINE * left, r.COUNTS_PER_LINE * right


async def _watchdog(driver: ZlacDriver, remarks: list[str]) -> int:
    """A watchdog that is on is fed from now on, whoever set it: else it would stop every longer move."""
    bus, attached = driver.bus, driver.attached
    milliseconds = await driver.read(r.WATCHDOG)
    if milliseconds == 0:
        remarks.append(
            "its watchdog is off (0x2000): its wheels go on turning when this program or the cable fails. "
            "Move it within `async with bus.watchdog(...)`"
        )
        return milliseconds
    if bus.owner.feeding.get(attached.address) is not None:
        return milliseconds
    if milliseconds != _SHIPPED:
        remarks.append(
            f"its watchdog is set to {milliseconds} ms (0x2000), perhaps by another program that was killed. It is fed "
            f"from now on; {OPTION} turns it off"
        )
    try:
        fed = await admit_and_arm(bus, attached, milliseconds / 1000)
    except WatchdogInfeasible as error:
        error.add_note(
            f"{driver.name} has had its watchdog set to {milliseconds} ms (0x2000) before this program. {OPTION} turns "
            "it off."
        )
        raise
    if not fed:
        raise NoReply(f"{driver.name} stopped answering while it was set up.", address=attached.address)
    return milliseconds
