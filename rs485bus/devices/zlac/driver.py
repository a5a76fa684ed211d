"""What both wheels of a ZLAC8015D share: requests, and its registers as far as they are known."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from rs485bus.arguments import flag, positive, whole
from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.adapter import FAMILY, ZlacAttached
from rs485bus.devices.zlac.frames import read, write, write_twins
from rs485bus.devices.zlac.telemetry import Snapshot, snapshot
from rs485bus.devices.zlac.values import Side, Synchrony
from rs485bus.errors import DeviceOffline, NoReply
from rs485bus.wire.frames import Request, payload, read_holding
from rs485bus.wire.registers import Block, Register, Repeat

T = TypeVar("T")

_JUST_NOW = 0.005
"""Seconds for which an answer may serve those, too, who asked meanwhile."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ZlacOptions:
    """How a drive is used, and what only the drive at hand can tell. Described at `Zlac8015d`."""

    max_rpm: float
    encoder_lines: int | None
    speed_resolution: int | None
    status_word_left: Literal["low", "high"]
    ramp_rpm: float | None
    scaled_position_speed: bool
    zero_in_position_mode: bool

    def __post_init__(self) -> None:
        positive("max_rpm", self.max_rpm)
        if self.encoder_lines is not None:
            whole("encoder_lines", self.encoder_lines, 1)
        if self.speed_resolution is not None:
            r.SPEED_RESOLUTION.raw(self.speed_resolution)
        if self.status_word_left not in ("low", "high"):
            raise ValueError(f"status_word_left {self.status_word_left!r} is neither 'low' nor 'high'")
        if self.ramp_rpm is not None:
            positive("ramp_rpm", self.ramp_rpm)
        flag("scaled_position_speed", self.scaled_position_speed)
        flag("zero_in_position_mode", self.zero_in_position_mode)


class ZlacDriver:
    """One drive.

    Args:
        bus: the bus it is on.
        attached: the drive, as the bus knows it.
        options: how it is used.
        restarted: called when it is seen to have restarted.
    """

    def __init__(self, bus: Bus, attached: ZlacAttached, options: ZlacOptions, restarted: Callable[[], None]) -> None:
        self.bus = bus
        self.attached = attached
        self.options = options
        self.name = f"{FAMILY} {attached.address}"
        self.restarted = restarted
        self.counts_per_turn = (4096, 4096)
        self.speed_resolution = 1
        """Steps to one rpm (0x2022)."""
        self.speed_limit = float(min(options.max_rpm, r.MAX_RPM))
        self.synchrony: Synchrony | None = None
        self.known = False
        """It was set up, and has answered since."""
        self._samples = [
            read_holding(attached.address, first, r.STATE.address + r.STATE.count - first)
            for first in range(r.STATE.address, r.REPORT.address - 1, -1)
        ]
        self._sampling = asyncio.Lock()
        self._sampled: Snapshot | None = None
        self._sampled_at = self._changed_at = bus.now()
        self.changing = asyncio.Lock()
        """Held while its mode is changed."""
        self._held: dict[int, int] = {}
        """The ramps and speeds that the drive holds, by address."""
        self._putting = asyncio.Lock()

    async def ask(
        self,
        request: Request,
        *,
        urgency: Urgency = Urgency.COMMAND,
        repeat: Repeat = Repeat.SAFE,
        moves: bool = False,
        motion: Motion | None = None,
        slot: BurstSlot | None = None,
    ) -> bytes:
        """Send a request. A drive that does not answer may have restarted: it is set up again before what follows."""
        try:
            return await self.bus.ask(request, urgency=urgency, repeat=repeat, moves=moves, motion=motion, slot=slot)
        except (NoReply, DeviceOffline):
            self.known = False
            raise
        finally:
            if request.writes:
                self.changed()

    async def read(self, register: Register[T]) -> T:
        return register.decode(payload(await self.ask(read(self.attached.address, register))))

    async def read_block(self, block: Block, urgency: Urgency = Urgency.COMMAND) -> tuple[Any, ...]:
        """The values of a block, with one request."""
        return block.decode(payload(await self.ask(read(self.attached.address, block), urgency=urgency)))

    async def write(self, register: Register[T], value: T) -> None:
        """Write something that sets nothing in motion; a stop drops it all the same."""
        await self.ask(write(self.attached.address, register, value), motion=self.attached.motion)

    async def sample(self, urgency: Urgency = Urgency.COMMAND) -> Snapshot:
        """Both wheels at one moment, with one request. Who asks while somebody else does gets the same."""
        async with self._sampling:
            sampled = self._sampled
            shared = sampled is not None and sampled.at >= self._changed_at
            if sampled is None or not shared or self.bus.now() > self._sampled_at + _JUST_NOW:
                sampled = self._sampled = await self._ask_sample(urgency)
                self._sampled_at = self.bus.now()
            return sampled

    async def _ask_sample(self, urgency: Urgency) -> Snapshot:
        at = self.bus.now()
        late = self.bus.owner.units[self.attached.address].late
        late.expire(at)
        # After a lost reply an equal request waits, lest it be answered late. One that reads a little more need not.
        request = next((request for request in self._samples if not late.must_wait(request)), self._samples[0])
        data = payload(await self.ask(request, urgency=urgency))
        return snapshot(data[2 * (r.STATE.address - request.register) :], at)

    def changed(self) -> None:
        """What was asked before this does not hold any more, whenever it is answered."""
        self._changed_at = self.bus.now()

    # Ramps and speeds

    async def put(self, *wanted: tuple[r.Twin[int], dict[Side, int]]) -> None:
        """Write what lies side by side for both wheels, in one frame, unless the drive holds it already."""
        async with self._putting:
            if not self._held:
                await self._read_held()
            pairs = []
            for twin, values in wanted:
                left, right = (values.get(side, self._held[twin.of(side).address]) for side in Side)
                pairs.append((twin, left, right))
            held = {twin.of(side).address: pair[side.index] for twin, *pair in pairs for side in Side}
            if held.items() <= self._held.items():
                return
            try:
                await self.ask(write_twins(self.attached.address, *pairs), motion=self.attached.motion)
            except BaseException:
                self._held.clear()  # whether it was written, nobody knows now
                raise
            self._held.update(held)
            self._see_ramps()

    async def read_held(self) -> None:
        """Read what `put` writes."""
        async with self._putting:
            await self._read_held()

    async def _read_held(self) -> None:
        values = iter(await self.read_block(r.CONTROL_BLOCK))
        self._held = {twin.of(side).address: next(values) for twin in r.CONTROLS for side in Side}
        self._see_ramps()

    def _see_ramps(self) -> None:
        times = (r.DECELERATION_TIME, r.QUICK_STOP_TIME)
        self.attached.ramp_takes = max(self._held[twin.of(side).address] for twin in times for side in Side) / 1000
