"""The plant as the service uses it: the one place that calls its axes."""

from __future__ import annotations

import asyncio
import dataclasses
import enum
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import AbstractAsyncContextManager
from typing import Any, Protocol

from rs485bus import AxisGroup
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.errors import BusError, MoveCancelled, NotSupported, StopUnconfirmed
from rs485bus.service import verbs
from rs485bus.service.decisions import Halt, Order
from rs485bus.service.topics import PLANT, VEHICLE, level
from rs485bus.service.verbs import Together, Verb

_LEAVING = "end_stream"


class Plant(Protocol):
    """What is served: a `rs485bus.plant.Plant` that is open, or what looks like one."""

    @property
    def name(self) -> str: ...

    @property
    def buses(self) -> Mapping[str, Bus]: ...

    @property
    def axes(self) -> Mapping[str, Any]: ...

    @property
    def groups(self) -> Mapping[str, Any]: ...

    @property
    def vehicle(self) -> Any: ...


class Performance:
    """A verb that is being carried out.

    Args:
        wait: waits for its end.
        moves: what of it moves axes.
        cancel: ends it, where that is possible.
    """

    def __init__(
        self,
        wait: Callable[[], Awaitable[Any]],
        moves: Iterable[Any] = (),
        cancel: Callable[[], None] | None = None,
    ) -> None:
        self.wait = wait
        self.cancel = cancel or (lambda: None)
        self._moves = list(moves)

    def starts(self) -> list[float]:
        """When each axis was started, on the event loop's clock."""
        return [move.started_at for move in self._moves if getattr(move, "started_at", None) is not None]

    @property
    def target(self) -> float | None:
        """Where it goes, if it is a move of one axis to a position."""
        return getattr(self._moves[0], "target", None) if len(self._moves) == 1 else None


class Machine:
    """Verbs, questions and stops, by names.

    Args:
        plant: an open plant.

    Raises:
        ValueError: a name of it cannot be served.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self._streams: dict[str, OpenStream] = {}
        self._emergencies: list[Handle[Any]] = []
        """The latest emergency stop, of each bus."""
        self.names: dict[str, frozenset[str]] = {name: frozenset({name}) for name in plant.axes}
        by_axis = {axis: name for name, axis in plant.axes.items()}
        for name, group in plant.groups.items():
            self.names[name] = frozenset(by_axis[axis] for axis in group.axes.values())
        if plant.vehicle is not None:
            wheels = (plant.vehicle.zlac.left, plant.vehicle.zlac.right)
            self.names[VEHICLE] = frozenset(by_axis[wheel] for wheel in wheels if wheel in by_axis)
        for name in self.names:
            level("the name", name)
            if name == PLANT:
                raise ValueError(f"{PLANT!r} is what the plant is called over a broker: give the axis another name")

    def verb(self, name: str, which: str) -> Verb | None:
        """What can be asked of a name; None for what cannot."""
        return self.table(name).get(which)

    def table(self, name: str) -> dict[str, Verb]:
        """All that can be asked of a name."""
        if name == PLANT:
            return verbs.PLANT
        target, table = self._target(name)
        return {which: verb for which, verb in table.items() if which in _OURS or hasattr(target, which)}

    def unit(self, name: str) -> str:
        """What the positions of an axis are called."""
        file = getattr(self.plant, "file", None)
        return "turns" if file is None else str(file.axes[name].unit)

    # Verbs

    def begin(self, order: Order) -> Performance:
        """Begin a verb: it acts when it is called. Raises what the verb raises where it does nothing."""
        if order.verb == "stream":
            return self._stream(order)
        if order.verb == _LEAVING:
            return self._leave(order)
        if order.verb == "clear_emergency_stop":
            return self._clear()
        target, _ = self._target(order.name)
        given = order.arguments.model_dump(exclude_none=True)
        if isinstance(order.arguments, Together):
            given |= given.pop("places")
            if order.name == PLANT:
                target = AxisGroup(**{name: self.plant.axes[name] for name in order.axes})
        handle = getattr(target, order.verb)(**given)
        if hasattr(handle, "moves"):
            parts = handle.moves.values()
        elif hasattr(handle, "left"):
            parts = (handle.left, handle.right)
        else:
            parts = (handle,)
        return Performance(handle.wait, parts, getattr(handle, "cancel", None))

    async def ask(self, order: Order) -> Any:
        """The answer to a question."""
        target, _ = self._target(order.name)
        return plain(await getattr(target, order.verb)())

    def halt(self, halt: Halt) -> Awaitable[None]:
        """Stop axes, at once. Awaiting it tells whether they stand.

        Raises:
            StopUnconfirmed: when it is awaited: they were not seen to.
        """
        for stream in list(self._streams.values()):
            if stream.axes & halt.axes:
                stream.end(MoveCancelled(f"The stream of {stream.name} ended: it was stopped."))
        if halt.emergency and halt.axes >= set(self.plant.axes):
            self._emergencies = [_asked_for(bus.emergency_stop) for bus in self.plant.buses.values()]
            return _confirmed(self._emergencies, self._all_standing)
        axes = [self.plant.axes[name] for name in sorted(halt.axes)]
        return _confirmed([_asked_for(axis.emergency_stop if halt.emergency else axis.stop) for axis in axes])

    # Streams

    def set_to(self, name: str, values: tuple[float, ...], seconds: float) -> None:
        """Give a stream a set-point that holds for so many seconds."""
        stream = self._streams.get(name)
        if stream is not None:
            stream.set_to(values, seconds)

    def _stream(self, order: Order) -> Performance:
        assert isinstance(order.arguments, verbs.Stream)
        target, _ = self._target(order.name)
        if not hasattr(target, "stream"):
            raise NotSupported(f"{order.name} takes no set-points: this release has no stream() for it.")
        earlier = self._streams.get(order.name)
        if earlier is not None:
            earlier.end(MoveCancelled(f"The stream of {order.name} ended: another one was opened."))
        stream = OpenStream(order.id, order.name, order.axes, target.stream(timeout=order.arguments.timeout))
        self._streams[order.name] = stream

        async def run() -> None:
            try:
                await stream.run()
            finally:
                if self._streams.get(order.name) is stream:
                    del self._streams[order.name]

        return Performance(run, cancel=lambda: stream.end(MoveCancelled(f"The stream of {order.name} was cancelled.")))

    def _leave(self, order: Order) -> Performance:
        assert isinstance(order.arguments, verbs.EndStream)
        stream = self._streams.get(order.name)
        if stream is None or stream.id != order.arguments.stream:
            return Performance(_nothing)  # it has ended
        stream.end(None)
        return Performance(stream.over.wait)

    # Inside

    def _clear(self) -> Performance:
        """Allow motion again, on all buses or on none."""
        if not all(emergency.done() for emergency in self._emergencies):
            raise BusError("The emergency stop is still being confirmed: wait until it is answered, then clear it.")
        for bus in self.plant.buses.values():
            bus.clear_emergency_stop()
        return Performance(_nothing)

    def _target(self, name: str) -> tuple[Any, dict[str, Verb]]:
        if name in self.plant.axes:
            return self.plant.axes[name], verbs.AXIS
        if name in self.plant.groups:
            return self.plant.groups[name], verbs.GROUP
        return self.plant.vehicle, verbs.VEHICLE if name == VEHICLE else {}

    @staticmethod
    def _all_standing(reports: list[Any]) -> None:
        moving = [str(report) for report in reports if not report.all_standing]
        if moving:
            raise StopUnconfirmed(f"{'; '.join(moving)}. Look at the machine; use the hard-wired emergency stop.")


_OURS = frozenset({"sample", "stream", _LEAVING})


class OpenStream:
    """A stream of set-points from a client.

    Args:
        request: what opened it.
        name: what it sets.
        axes: what that moves.
        block: the stream, as the axis gives it.
    """

    def __init__(
        self, request: str, name: str, axes: frozenset[str], block: AbstractAsyncContextManager[Callable[..., Any]]
    ) -> None:
        self.id = request
        self.name = name
        self.axes = axes
        self.over = asyncio.Event()
        self._block = block
        self._set: Callable[..., Any] | None = None
        self._zero: tuple[float, ...] = (0.0,)
        self._end: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._stale: asyncio.TimerHandle | None = None

    async def run(self) -> None:
        """Set what comes, until the end; where it was stopped, until what it moves was seen standing.

        Raises:
            MoveCancelled: it was stopped, and stands.
            StopUnconfirmed: it was stopped, and not seen to stand.
            MotionError, RequestFailed: what it has failed of.
        """
        try:
            async with self._block as setpoint:
                self._set = setpoint
                if hasattr(self._block, "on_end"):
                    self._block.on_end(self.end)
                try:
                    await self._end
                finally:
                    self._set = None
                    if self._stale is not None:
                        self._stale.cancel()
        finally:
            self.over.set()

    def set_to(self, values: tuple[float, ...], seconds: float) -> None:
        """A set-point. It holds for so many seconds: it may have been on its way for a while."""
        if self._set is None:
            return
        try:
            self._set(*values)
        except (BusError, ValueError, TypeError) as error:
            self.end(error)
            return
        self._zero = (0.0,) * len(values)
        if self._stale is not None:
            self._stale.cancel()
        self._stale = asyncio.get_running_loop().call_later(seconds, self._slow_down)

    def end(self, error: Exception | None) -> None:
        """It ends, well or not."""
        if not self._end.done():
            if error is None:
                self._end.set_result(None)
            else:
                self._end.set_exception(error)

    def _slow_down(self) -> None:
        if self._set is not None:
            self._set(*self._zero)


async def _nothing() -> None:
    """It is done already."""


def _asked_for(stop: Callable[[], Handle[Any]]) -> Handle[Any]:
    """A stop. One that raises, whatever that is, does not keep the others from being asked for."""
    try:
        return stop()
    except Exception as error:
        failed: Handle[Any] = Handle("stop")
        failed.fail(error)
        return failed


async def _confirmed(handles: list[Any], check: Callable[[list[Any]], None] = lambda _: None) -> None:
    """Wait for all; raise the first error."""
    ended = await asyncio.gather(*(handle.wait() for handle in handles), return_exceptions=True)
    for error in ended:
        if isinstance(error, BaseException):
            raise error
    check(list(ended))


def plain(value: Any) -> Any:
    """A value as JSON has it."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, enum.Flag):
        return [part.name for part in value]
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return {name: plain(part) for name, part in zip(value._fields, value, strict=True)}
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(part) for part in value]
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)
