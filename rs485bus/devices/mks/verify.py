"""Finds out what feeds the watchdog of a real MKS drive. Its manual says "instructions" and no more (3.2.14)."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import anyio

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import FAMILY
from rs485bus.devices.mks.frames import read, write
from rs485bus.devices.mks.servo import MksServo
from rs485bus.errors import DeviceRefused, MotionError, NoReply
from rs485bus.wire.frames import BROADCAST, MAX_ADDRESS, payload
from rs485bus.wire.registers import Repeat

RPM = 32
"""The speed of the test: slow, told from standing, and one that can be told at any microsteps."""
_TIMES = 3.0
_EVERY = 1 / 3


@dataclass(frozen=True, slots=True)
class WatchdogFindings:
    """What feeds a drive's watchdog."""

    trips: bool
    """It stops a turning motor when nothing is sent. If not, it is no protection."""
    reads_feed: bool
    """Reads keep it from tripping, as the heartbeats of this package are."""
    others_feed: bool
    """Frames to other drives keep it from tripping: it would not notice that it is left alone."""
    broadcasts_feed: bool
    latches: bool
    """After a trip it moves only when it was enabled again."""

    @property
    def protects(self) -> bool:
        """Whether it can be relied on with this package's heartbeats."""
        return self.trips and self.reads_feed


async def verify_watchdog(
    servo: MksServo, timeout: float = 1.0, say: Callable[[str], None] = lambda text: None
) -> WatchdogFindings:
    """Turn the motor slowly, five times for three times `timeout`, and see when its watchdog stops it.

    Nothing else may talk to the drive meanwhile, and no other drive be on the bus that acts on broadcasts.

    Args:
        servo: the drive, alone on its bus.
        timeout: what its watchdog is set to, in seconds.
        say: is told what goes on.

    Raises:
        RequestFailed, MotionError: the drive did not do what it was told.
    """
    every = _EVERY * timeout

    async def nothing() -> None:
        await anyio.sleep(every)

    async def reads() -> None:
        await servo.bus.ask(read(servo.address, r.STATUS))
        await anyio.sleep(every)

    # Always another one, lest the bus takes it for offline and asks no more.
    nobody = itertools.cycle(address for address in range(MAX_ADDRESS, 0, -1) if address != servo.address)

    async def others() -> None:
        with contextlib.suppress(NoReply):
            await servo.bus.ask(read(next(nobody), r.STATUS), repeat=Repeat.NEVER)
        await anyio.sleep(every)

    async def broadcasts() -> None:
        # Releasing a stall that is none does nothing.
        await servo.bus.ask(write(BROADCAST, r.RELEASE_STALL, 1), repeat=Repeat.NEVER, family=FAMILY)
        await anyio.sleep(every)

    await servo.enable()
    await servo.bus.ask(write(servo.address, r.WATCHDOG, round(1000 * timeout)))
    try:
        turns: dict[str, bool] = {}
        for name, traffic in (("reads", reads), ("frames to others", others), ("broadcasts", broadcasts)):
            turns[name] = await _goes_on(servo, timeout, traffic)
            say(f"{name} only: {'it goes on turning' if turns[name] else 'it stops'}")
        trips = not await _goes_on(servo, timeout, nothing, then_stop=False)
        say(f"nothing at all: {'it stops' if trips else 'it goes on turning'}")
        latches = trips and not await _starts(servo)
        if trips:
            say(f"after that {'it needs enabling' if latches else 'it moves again when it is told to'}")
    finally:
        await servo.stop()
        await servo.bus.ask(write(servo.address, r.WATCHDOG, 0))
    return WatchdogFindings(trips, turns["reads"], turns["frames to others"], turns["broadcasts"], latches)


async def _goes_on(
    servo: MksServo, timeout: float, traffic: Callable[[], Awaitable[None]], *, then_stop: bool = True
) -> bool:
    """Whether the motor still turns after three times the watchdog's time with nothing but this traffic."""
    await servo.enable()
    await servo.run(RPM)
    with servo.left_alone(), anyio.move_on_after(_TIMES * timeout):
        while True:
            await traffic()
    turning = await _turns(servo)
    if then_stop:
        await servo.stop()
    return turning


async def _starts(servo: MksServo) -> bool:
    """Whether the motor moves when it is told to, without being enabled."""
    try:
        await servo.run(RPM)
    except (DeviceRefused, MotionError):
        return False
    return await _turns(servo)


async def _turns(servo: MksServo) -> bool:
    speed = r.SPEED.decode(payload(await servo.bus.ask(read(servo.address, r.SPEED))))
    return abs(speed) > RPM // 3
