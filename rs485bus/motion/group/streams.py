"""Set-points for axes together: one call tells all of them, and where one fails all stop."""

from __future__ import annotations

import asyncio
import contextlib
import functools
from collections.abc import Mapping
from contextlib import AsyncExitStack
from types import TracebackType
from typing import Protocol, runtime_checkable

from rs485bus.bus.async_block import AsyncBlock
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.errors import BusError, MoveCancelled, StopUnconfirmed
from rs485bus.motion.group.member import GroupMember
from rs485bus.motion.group.several import named
from rs485bus.motion.setpoints import Setpoint, SetpointStream


@runtime_checkable
class StreamAxis(Protocol):
    """An axis that can be told a stream of speeds."""

    name: str
    bus: Bus

    def stream(self, *, timeout: float = ..., acceleration: float | None = ...) -> SetpointStream:
        """Turn at speeds that are told as they come."""

    def stop(self) -> Handle[None]:
        """Stop it with its ramp."""


class GroupSetpoint:
    """What a stream of several axes is told: `setpoint(x=90.0, y=-30.0)`. Speeds are rpm.

    Args:
        parts: the set-point of each axis, by name.
    """

    def __init__(self, parts: Mapping[str, Setpoint]) -> None:
        self._parts = parts
        self.error: Exception | None = None
        """What has ended it. It is told as soon as the stops of all axes are on the wire."""
        self._is_broken = False
        """One axis has failed: the stops of the others are on their way."""
        self._told = asyncio.Event()

    def __call__(self, **rpm: float) -> None:
        """Have the axes that are named turn at these speeds from now on. Those that are not named keep theirs, until
        they are too old.

        Nothing is told while one has failed and the stops of the others are on their way to the wire.

        Raises:
            TypeError: there is no axis of that name, or it is no number.
            LimitExceeded: it is no speed. Nothing is told then.
            MotionError, RequestFailed: what has ended the stream: all axes stand, or their stops are on the wire.
        """
        unknown = [name for name in rpm if name not in self._parts]
        if unknown or not rpm:
            raise TypeError(f"name the axes to be told a speed; there are {', '.join(self._parts)}, not {unknown}")
        if self.error is not None:
            raise self.error
        for name, speed in rpm.items():
            self._parts[name].check(speed)
        for name, speed in rpm.items():
            if not self._is_broken:
                self._parts[name](speed)

    async def reached(self) -> None:
        """Wait until all speeds that are wanted were told, to the end of their ramps. Raises what has ended it."""
        try:
            for part in self._parts.values():
                await part.reached()
        except BusError:
            await self._check()
            raise

    def _break_off(self, who: str, error: Exception, axes: Mapping[str, GroupMember]) -> None:
        """One axis has failed, and the others were told to stop: that is told when their stops are on the wire."""
        waited_for = {axis.bus for axis in axes.values()}

        def out(bus: Bus) -> None:
            waited_for.discard(bus)
            if not waited_for:
                self.error = named(who, error, axes)
                self._told.set()

        for bus in tuple(waited_for):
            bus.after_stops(functools.partial(out, bus))

    async def _check(self) -> None:
        """Raise what has ended it, as soon as that is told."""
        if self._is_broken:
            await self._told.wait()
        if self.error is not None:
            raise self.error

    @property
    def sent(self) -> dict[str, float]:
        """The speeds that were told last, in rpm."""
        return {name: part.sent for name, part in self._parts.items()}

    @property
    def measured(self) -> dict[str, float | None]:
        """The speeds that were last seen, in rpm."""
        return {name: part.measured for name, part in self._parts.items()}


class _Turn:
    """Where the streams of a group wait for each other: one that has begun may be in the way of what is asked of
    another axis before its stream, as two wheels of one drive are.

    Args:
        missing: how many are waited for.
    """

    def __init__(self, missing: int) -> None:
        self._missing = missing
        self._all = asyncio.Event()

    async def come(self) -> None:
        """One stream's turn has come: wait for that of the others."""
        self._missing -= 1
        if not self._missing:
            self._all.set()
        await self._all.wait()

    def give_up(self, _: Exception | None) -> None:
        """One has ended: it is waited for no longer."""
        self._all.set()


class GroupStream(AsyncBlock):
    """A stream for several axes: `async with group.stream() as setpoint: setpoint(x=90.0, y=-30.0)`.

    Args:
        axes: the axes, by name.
        streams: theirs.
        members: the axes, as those see them that move with them.
    """

    def __init__(
        self,
        axes: Mapping[str, StreamAxis],
        streams: Mapping[str, SetpointStream],
        members: Mapping[str, GroupMember],
    ) -> None:
        self._axes = axes
        self._streams = streams
        self._members = members
        self._stack = AsyncExitStack()
        self._setpoint: GroupSetpoint | None = None

    async def __aenter__(self) -> GroupSetpoint:
        name = None
        try:
            turn = _Turn(len(self._streams))
            for stream in self._streams.values():
                stream._join(turn.come)  # all at once: what two axes do together must not come between
                stream.on_end(turn.give_up)
            for stream in self._streams.values():
                stream._check_wait()
            async with AsyncExitStack() as stack:
                parts = {}
                for name, stream in self._streams.items():
                    parts[name] = await stack.enter_async_context(stream)
                self._setpoint = GroupSetpoint(parts)
                self._stack = stack.pop_all()
        except BaseException as error:
            for stream in self._streams.values():
                stream._withdraw()
            if name is None or not isinstance(error, BusError):
                raise
            for stream in self._streams.values():  # one that has begun may have turned before
                with contextlib.suppress(StopUnconfirmed):  # that is said below
                    await stream._stopped()
            raise named(name, error, self._members) from error
        for name, stream in self._streams.items():
            stream.on_end(functools.partial(self._ended, name))
        return self._setpoint

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        setpoint = self._setpoint
        assert setpoint is not None
        for axis, stream in zip(self._axes.values(), self._streams.values(), strict=True):
            if error is None:
                stream.end()  # all at once
            elif not stream.over:
                with contextlib.suppress(BusError):  # it is stopped all the same when its own block is left
                    axis.stop()
        try:
            swallowed = await self._stack.__aexit__(kind, error, trace)
        except BusError:
            if error is None:
                await setpoint._check()
            raise
        if error is None:
            await setpoint._check()
        return swallowed

    def _ended(self, who: str, error: Exception | None) -> None:
        """The stream of one axis has ended: where that was not meant, the others are stopped."""
        setpoint = self._setpoint
        if error is None or isinstance(error, MoveCancelled) or setpoint is None or setpoint._is_broken:
            return
        setpoint._is_broken = True
        for axis, stream in zip(self._axes.values(), self._streams.values(), strict=True):
            if not stream.over:
                with contextlib.suppress(BusError):  # one that cannot be stopped must not keep the others from it
                    axis.stop()
        setpoint._break_off(who, error, self._members)
