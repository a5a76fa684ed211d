"""Enabling a ZLAC8015D, its modes, and what its wheels are told in them. Source: ZLAC8015D RS485 V1.06, 3.

Both wheels share the control word, the mode and the way of starting. Whoever needs another mode waits until the other
wheel has done what it does in this one. A mode is entered as the routines of 3 do it: mode, ramps, enable, target; but
its targets are made harmless first, so that neither the change nor the enabling goes on with an old one.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

from rs485bus.bus.handle import Handle, settle
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.driver import ZlacDriver
from rs485bus.devices.zlac.frames import control, write, write_twins
from rs485bus.devices.zlac.telemetry import Snapshot
from rs485bus.devices.zlac.values import ControlMode, ControlWord, ShaftState, Side, Synchrony
from rs485bus.errors import (
    DriveFault,
    NoReply,
    NotEnabled,
    NotSupported,
    OutcomeUnknown,
    StopUnconfirmed,
)
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Repeat

_STARTS = {Side.LEFT: ControlWord.START_LEFT, Side.RIGHT: ControlWord.START_RIGHT}


@dataclass(frozen=True, slots=True)
class Target:
    """Where a wheel is sent, in counts; from where, in case that only a distance can be said; and how fast."""

    counts: int
    start: int
    rpm: int
    ramp: int
    """ms"""


class ZlacModes:
    """Which mode a drive is in, who is busy in it, and what its wheels are told.

    Args:
        driver: the drive.
    """

    def __init__(self, driver: ZlacDriver) -> None:
        self.driver = driver
        self.paused = False
        """A controlled stop was made by control word 0x05: enabled again before the next command."""
        self._kept: dict[Side, ControlMode] = {}
        self.hurried: set[Handle[Any]] = set()
        """Runs whose speed nobody waits for any more, because another one follows."""
        self.ready = False
        """It was enabled here, and nothing has happened since."""
        self.enabling = asyncio.Lock()
        self.told_at = {Side.LEFT: 0.0, Side.RIGHT: 0.0}
        """When each wheel was last told to move, on the event loop's clock."""
        self._busy: dict[Side, ControlMode] = {}
        self._under_way: set[Side] = set()
        self._freed = asyncio.Event()
        self._turns = asyncio.Lock()
        self._speeds = {Side.LEFT: 0.0, Side.RIGHT: 0.0}

    # Who does what

    @asynccontextmanager
    async def reserve(self, side: Side, mode: ControlMode, *, alone: bool) -> AsyncIterator[None]:
        """A command of a wheel needs a mode while it is carried out. `alone`: not together with the other wheel.

        Raises:
            NotSupported: the other wheel keeps a speed or a torque in another mode.
        """
        other = Side.RIGHT if side is Side.LEFT else Side.LEFT
        async with self._turns:
            while alone:
                keeps = self.keeps(other)
                if keeps is not None and keeps is not mode:
                    raise NotSupported(
                        f"{self.driver.name}: both wheels share one control mode, and the {other.name.lower()} one "
                        f"keeps a {keeps.name.lower()}. Stop that one first."
                    )
                if self._busy.get(other, mode) is mode:
                    break
                self._freed.clear()
                await self._freed.wait()
            self._busy[side] = mode
        try:
            yield
        finally:
            del self._busy[side]
            self._under_way.discard(side)
            self._freed.set()

    def keep(self, side: Side, mode: ControlMode | None) -> None:
        """A wheel keeps a speed or a torque from now on; None for neither."""
        if mode is None:
            self._kept.pop(side, None)
        else:
            self._kept[side] = mode

    def keeps(self, side: Side) -> ControlMode | None:
        """In which mode a wheel keeps a speed or a torque. It does not any more once it was seen standing, for whatever
        reason."""
        return self._kept.get(side) if self.driver.attached.sides[side].may_move else None

    def speed(self, side: Side) -> float:
        """How fast a wheel was told to turn, in rpm; 0 if it does not keep a speed."""
        return abs(self._speeds[side]) if self.keeps(side) is ControlMode.VELOCITY else 0.0

    def hurry(self, run: Handle[Any]) -> None:
        """Do not wait for the speed of a run, nor tell it if it was not told yet: another one follows."""
        if not run.done():
            self.hurried.add(run)
            run.add_done_callback(self.hurried.discard)

    async def overtaken(self, commands: dict[Side, Handle[Any] | None]) -> bool:
        """Whether another run follows already. Asked once for both wheels, so that both do the same."""
        return any(command in self.hurried for command in commands.values())

    async def enter(self, mode: ControlMode, synchrony: Synchrony, *sides: Side) -> None:
        """Have the drive in a mode, for wheels that stand. They are under way from then on."""
        attached, driver = self.driver.attached, self.driver

        def is_so() -> bool:
            return attached.mode is mode and driver.synchrony is synchrony

        # Who is under way does not come here to wait: it is so for him.
        while not is_so():
            async with self.driver.changing:
                while not is_so() and self._under_way.difference(sides):
                    self._freed.clear()
                    await self._freed.wait()
                if not is_so():
                    await self._change(mode, synchrony)
        self._under_way.update(sides)

    async def _change(self, mode: ControlMode, synchrony: Synchrony) -> None:
        driver, attached = self.driver, self.driver.attached
        if driver.synchrony is not synchrony:
            # Not known while it is written, so that nobody begins anything meanwhile.
            driver.synchrony = None
            await driver.write(r.SYNCHRONY, synchrony)
            driver.synchrony = synchrony
        if attached.mode is not mode:
            attached.mode = None
            await self._neutral(*await self._harmless(mode))
            await driver.write(r.MODE, mode)
            await self._control(ControlWord.ENABLE)
            attached.mode = mode

    async def _harmless(self, mode: ControlMode) -> list[tuple[r.Twin[int], int, int]]:
        """Targets that leave standing wheels where they are."""
        if mode is not ControlMode.POSITION_ABSOLUTE:
            twin = {ControlMode.VELOCITY: r.TARGET_VELOCITY, ControlMode.TORQUE: r.TARGET_TORQUE}.get(mode)
            return [(twin or r.TARGET_POSITION, 0, 0)]
        seen = await self.driver.sample()
        left, right = (max(-r.MAX_ABSOLUTE, min(r.MAX_ABSOLUTE, wheel.position)) for wheel in seen.motion)
        return [(r.TARGET_POSITION, left, right)]

    # Enabling

    @property
    def busy(self) -> bool:
        """Whether a wheel was told something that it may be doing still."""
        return bool(self._under_way) or any(self.keeps(side) for side in Side)

    async def enable(self) -> None:
        """Hold both wheels, with no target left from before.

        Raises:
            DriveFault: it reports an error.
            NotEnabled: it does not do so.
        """
        async with self.driver.changing:
            seen = await self.driver.sample()
            self.check_faults(seen)
            if seen.status.enabled and (self.ready or self.busy) and not self.paused:
                return
            await self._zero_targets()
            self.driver.attached.mode = None
            await self.driver.write(r.MODE, ControlMode.VELOCITY)
            await self._control(ControlWord.ENABLE)
            self.driver.attached.mode = ControlMode.VELOCITY
            seen = await self.driver.sample()
            self.check_faults(seen)
            if not seen.status.enabled:
                raise NotEnabled(f"{self.driver.name} was told to enable its motors. {await self._why_not(seen)}")
            self.paused = False
            self.ready = True

    async def resume(self) -> bool:
        """Enable it again after a controlled stop that only an emergency stop could make. Whether that was needed."""
        unit = self.driver.bus.owner.units[self.driver.attached.address]
        if unit.halt is not None:
            halted: asyncio.Future[Halted] = asyncio.get_running_loop().create_future()
            unit.halt.listen(lambda ended: settle(halted, ended))
            if not (await halted).standing:
                raise StopUnconfirmed(f"{self.driver.name} was told to stop and could not be seen standing.")
        resumes = self.paused
        if resumes:
            await self.enable()
        return resumes

    async def release(self) -> None:
        """Let go of both wheels (0x07). They can be turned by hand then, and roll away on a slope."""
        async with self.driver.changing:
            self.ready = self.paused = False
            await self._control(ControlWord.RELEASE)

    async def clear_faults(self) -> None:
        """Clear the errors of both wheels (0x06).

        Raises:
            DriveFault: they are there again.
        """
        async with self.driver.changing:
            self.ready = False
            await self._zero_targets()
            await self._control(ControlWord.CLEAR_FAULT)
            self.check_faults(await self.driver.sample())

    def quick_stopped(self, emergency: bool, enabled: bool) -> None:
        """Control word 0x05 goes out."""
        self.paused = not emergency and (self.paused or enabled)
        self.ready = False
        self._kept.clear()

    def doubt(self, emergency: bool) -> bool:
        """Whether such a stop concerns both wheels. Whoever asks for one may know of a motion that is not known here,
        so that it is not left out because the wheels are thought to stand."""
        attached = self.driver.attached
        both = emergency or attached.mode is not ControlMode.VELOCITY
        if both:
            attached.motion.commanded(self.driver.bus.now())
        return both

    def check_faults(self, seen: Snapshot) -> None:
        """Raise `DriveFault` if either wheel reports an error."""
        named = [
            f"{side.name.lower()} {faults.describe()}" for side, faults in zip(Side, seen.faults, strict=True) if faults
        ]
        if named:
            raise DriveFault(
                f"{self.driver.name} reports: {'; '.join(named)}. Then clear_faults() and enable(); both wheels stop "
                "for an error of one."
            )

    async def _why_not(self, seen: Snapshot) -> str:
        if not seen.status.either(ShaftState.EMERGENCY_STOP):
            return "It says that it is not enabled."
        (inputs, _), (reversed_, *_) = await self.driver.read_block(r.PORTS), await self.driver.read_block(r.TERMINALS)
        active = inputs ^ reversed_
        return f"It is in emergency stop, with inputs {active!r}. Release its emergency-stop input (0x2017, 0x2018)."

    async def _zero_targets(self) -> None:
        await self._neutral((r.TARGET_VELOCITY, 0, 0), (r.TARGET_POSITION, 0, 0))
        await self._neutral((r.TARGET_TORQUE, 0, 0))

    async def _neutral(self, *pairs: tuple[r.Twin[int], int, int]) -> None:
        driver = self.driver
        await driver.ask(write_twins(driver.attached.address, *pairs), motion=driver.attached.motion)

    async def _control(self, word: ControlWord) -> None:
        driver = self.driver
        await driver.ask(control(driver.attached.address, word), motion=driver.attached.motion)

    # Targets

    async def run(self, wanted: dict[Side, tuple[float, float]]) -> None:
        """Have wheels turn: (rpm, rpm/s) in the drive's direction. Raises `OutcomeUnknown`."""
        driver = self.driver
        await self.enter(ControlMode.VELOCITY, Synchrony.ASYNCHRONOUS, *wanted)
        times = {}
        for side, (rpm, acceleration) in wanted.items():
            # The way down is set with the way up: whatever stops the wheel next then has the ramp that fits its speed.
            fastest = max(abs(rpm), self.speed(side))
            times[side] = min(r.MAX_RAMP, round(1000 * (driver.options.ramp_rpm or fastest) / acceleration))
        await driver.put((r.ACCELERATION_TIME, times), (r.DECELERATION_TIME, times))
        self._speeds.update({side: rpm for side, (rpm, _) in wanted.items()})
        steps = {side: round(rpm * driver.speed_resolution) for side, (rpm, _) in wanted.items()}
        await self._tell(r.TARGET_VELOCITY, steps)

    async def push(self, wanted: dict[Side, tuple[int, int | None]]) -> None:
        """Have wheels push: (mA, mA/s or None) in the drive's direction. Raises `OutcomeUnknown`."""
        await self.enter(ControlMode.TORQUE, Synchrony.ASYNCHRONOUS, *wanted)
        slopes = {side: slope for side, (_, slope) in wanted.items() if slope is not None}
        if slopes:
            await self.driver.put((r.TORQUE_SLOPE, slopes))
        await self._tell(r.TARGET_TORQUE, {side: torque for side, (torque, _) in wanted.items()})

    async def aim(self, wanted: dict[Side, Target]) -> None:
        """Tell wheels where to go, and how fast, without setting them in motion."""
        driver = self.driver
        relative = any(abs(target.counts) > r.MAX_ABSOLUTE for target in wanted.values())
        mode = ControlMode.POSITION_RELATIVE if relative else ControlMode.POSITION_ABSOLUTE
        synchrony = Synchrony.SYNCHRONOUS if len(wanted) == len(Side) else Synchrony.ASYNCHRONOUS
        await self.enter(mode, synchrony, *wanted)
        times = {side: target.ramp for side, target in wanted.items()}
        await driver.put((r.ACCELERATION_TIME, times), (r.DECELERATION_TIME, times))
        scale = driver.speed_resolution if driver.options.scaled_position_speed else 1
        await driver.put((r.POSITION_SPEED, {side: target.rpm * scale for side, target in wanted.items()}))
        counts = {side: target.counts - target.start * relative for side, target in wanted.items()}
        await driver.ask(self._targets(r.TARGET_POSITION, counts), motion=self._motion(wanted))

    async def launch(self, wheels: Collection[Side], slot: BurstSlot | None) -> None:
        """Start wheels that were told where to go. Raises `OutcomeUnknown` if nobody knows whether they started."""
        driver, request = self.driver, self.start_frame(wheels)
        self.told_at.update(dict.fromkeys(wheels, driver.bus.now()))
        await driver.ask(request, repeat=Repeat.VERIFY, moves=True, motion=self._motion(wheels), slot=slot)

    def start_frame(self, wheels: Collection[Side]) -> Request:
        """What starts wheels that were told where to go."""
        word = ControlWord.START_BOTH if len(wheels) == len(Side) else _STARTS[next(iter(wheels))]
        return control(self.driver.attached.address, word)

    async def told(self, twin: r.Twin[int], wanted: dict[Side, int]) -> bool:
        """Whether the drive holds these targets."""
        return all([await self.driver.read(twin.of(side)) == value for side, value in wanted.items()])

    async def _tell(self, twin: r.Twin[int], wanted: dict[Side, int]) -> None:
        """Write targets that hold at once. The same again is the same, so they may be repeated."""
        request = self._targets(twin, wanted)
        self.told_at.update(dict.fromkeys(wanted, self.driver.bus.now()))
        try:
            await self.driver.ask(request, moves=True, motion=self._motion(wanted))
        except NoReply as error:
            raise OutcomeUnknown(str(error), address=error.address, request=error.request) from error

    def _targets(self, twin: r.Twin[int], wanted: dict[Side, int]) -> Request:
        address = self.driver.attached.address
        if len(wanted) == len(Side):
            return write_twins(address, (twin, wanted[Side.LEFT], wanted[Side.RIGHT]))
        ((side, value),) = wanted.items()
        return write(address, twin.of(side), value)

    def _motion(self, sides: Collection[Side]) -> Motion:
        attached = self.driver.attached
        return attached.motion if len(sides) == len(Side) else attached.sides[next(iter(sides))]
