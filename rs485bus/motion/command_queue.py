"""The queue of commands of one axis, and the task that carries them out one after the other."""

from __future__ import annotations

import asyncio
import copy
import itertools
import logging
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.errors import BusError, DeviceRefused, MotionError, MoveCancelled, MoveFailed, NotSent, QueueFull
from rs485bus.motion.move import Move
from rs485bus.wire.frames import is_read

T = TypeVar("T")

_log = logging.getLogger("rs485bus")

MAX_QUEUED = 64
"""Commands that may wait on one axis."""


class CommandQueue:
    """Commands, in the order in which they were given.

    A command that fails cancels those behind it, and no new one is taken until somebody has seen the failure.

    Args:
        bus: carries the task.
        name: the axis, in messages.
        upset: told when what is queued is not carried out as it was planned.
        stop: stops the axis, if it may move; called when a command ends in an error that nobody foresaw.
        make_safe: has the axis seen standing, or stopped, after a command that has failed; it is given that, and
            returns whether it stops the axis.
    """

    def __init__(
        self,
        bus: Bus,
        name: str,
        upset: Callable[[], None],
        stop: Callable[[], object],
        make_safe: Callable[[Handle[Any]], Awaitable[bool]],
    ) -> None:
        self._bus = bus
        self._name = name
        self._upset = upset
        self._stop = stop
        self._make_safe = make_safe
        self._waiting: deque[tuple[Handle[Any], Callable[[], Awaitable[Any]]]] = deque()
        self._current: Handle[Any] | None = None
        self._worker: asyncio.Task[None] | None = None
        self._failed: Handle[Any] | None = None
        self._unawaited: Handle[Any] | None = None
        """A failure that nobody could await."""
        self._hold: Handle[Any] | None = None
        self._drained_by = 0
        """How many wait for its end: what goes on until a block is left is ended."""
        self._joints: dict[Handle[Any], object] = {}

    def pair(self, handle: Handle[Any], joint: object) -> None:
        """A command is carried out together with other axes."""
        self._joints[handle] = joint
        handle.add_done_callback(lambda ended: self._joints.pop(ended, None))

    @property
    def joint(self) -> object | None:
        """Those who carry out the present command together with this axis."""
        return None if self._current is None else self._joints.get(self._current)

    @property
    def current(self) -> Handle[Any] | None:
        """The command that is being carried out."""
        return self._current

    @property
    def idle(self) -> bool:
        """Whether nothing waits or is being carried out."""
        return self._current is None and not self._waiting

    def check(self) -> None:
        """Raise what keeps the queue from taking another command."""
        failed = self._failed
        if failed is not None and failed is self._unawaited and not failed.seen:
            assert failed.error is not None
            failed.seen = True
            raise failed.error
        if failed is not None and not failed.seen:
            raise MotionError(
                f"{self._name} takes no commands: {failed.what} failed ({failed.error}), and nobody has seen it. "
                "Await that handle, or enable() the axis."
            ) from failed.error
        if len(self._waiting) >= MAX_QUEUED:
            raise QueueFull(f"{MAX_QUEUED} commands wait on {self._name} already. Await some of them first.")

    def add(self, handle: Handle[T], carry_out: Callable[[], Awaitable[T]]) -> None:
        """Queue a command that was checked."""
        if self._hold is not None and self._hold.done():
            self._hold = None  # whoever commands it now knows how that stop ended
        handle._ahead = lambda: self._ahead_of(handle)
        self._waiting.append((handle, carry_out))
        if self._worker is None:
            self._worker = self._bus.spawn(self._work(), f"rs485bus {self._name}")

    def forgive(self) -> None:
        """Take commands again after a failure that nobody has seen."""
        self._failed = None

    def fail(self, failure: Handle[Any], error: Exception) -> None:
        """What goes on without a command has failed: who gives the next one is told."""
        self._failed = self._unawaited = failure
        failure.fail(error)
        self._cancel_waiting(MoveCancelled(f"Cancelled: {failure.what} failed before it ({error})."))

    def hold(self, until: Handle[Any]) -> None:
        """Begin no other command before that one has ended."""
        self._hold = until

    def remove(self, handle: Handle[Any], error: Exception) -> bool:
        """Take a command out that waits. False if it does not."""
        for entry in self._waiting:
            if entry[0] is handle:
                self._waiting.remove(entry)
                handle.fail(error)
                return True
        return False

    def cut(self, handle: Handle[Any], error: Exception) -> None:
        """End a command that waits, if it does, and those behind it."""
        waiting = [entry[0] for entry in self._waiting]
        if handle in waiting:
            kept = waiting.index(handle)
            ended = [self._waiting.pop() for _ in waiting[kept:]][::-1]
            self._upset()
            for other, _ in ended:
                other.fail(error if other is handle else MoveCancelled(f"Cancelled: {error}"))

    def interrupt(self, error: Exception, waiting: Exception | None = None) -> None:
        """End everything: the command under way, and those that wait, perhaps with an error of their own."""
        worker, self._worker = self._worker, None
        current, self._current = self._current, None
        if worker is not None:
            worker.cancel()
        if current is not None:
            current.fail(error)
        self._cancel_waiting(waiting or error)

    async def drain(self) -> None:
        """Wait until nothing waits or is being carried out. What goes on until a block is left is ended."""
        self._drained_by += 1
        try:
            self._end_block()
            while self._worker is not None:
                await asyncio.wait([self._worker])
        finally:
            self._drained_by -= 1
        await self.held()

    async def held(self) -> bool:
        """Wait for the stop that must end first. False if it was not confirmed."""
        hold = self._hold
        if hold is None:
            return True
        seen = hold.seen
        try:
            await hold.wait()
        except MotionError:
            hold.seen = seen  # this is not who is to be told
            return False
        finally:
            if hold is self._hold and hold.done():
                self._hold = None
        return True

    def _end_block(self) -> None:
        """End what goes on until a block is left, where somebody waits for the end of all."""
        if self._drained_by and self._current is not None and self._current._end_block is not None:
            self._current._end_block()

    def _ahead_of(self, handle: Handle[Any]) -> list[Handle[Any]]:
        """The commands that are done before one."""
        ahead = [] if self._current is None or self._current is handle else [self._current]
        if self._current is not handle:
            ahead += itertools.takewhile(lambda each: each is not handle, (waiting for waiting, _ in self._waiting))
        return ahead

    def kept_open(self) -> list[Handle[Any]]:
        """The command that is carried out, if it ends only when somebody leaves a block."""
        return [] if self._current is None or self._current._kept_open_by is None else [self._current]

    async def _work(self) -> None:
        me = asyncio.current_task()
        try:
            while self._waiting:
                if self._hold is not None:
                    if not await self.held():
                        self._cancel_waiting(MoveCancelled(f"Cancelled: {self._name} was not seen standing before it."))
                    continue  # meanwhile what waited may have been taken out, or another stop have begun
                handle, carry_out = self._waiting.popleft()
                self._current = handle
                self._end_block()
                try:
                    result = await carry_out()
                except Exception as error:
                    if unsafe := not isinstance(error, BusError):
                        error = _as_told(handle, error)
                    else:
                        try:
                            error = _of_a_motion(handle, error, stopped=await self._make_safe(handle))
                        except Exception:
                            _log.exception("%s: it cannot be seen to what %s has led", self._name, handle.what)
                            unsafe = True
                    self._current = None
                    self._failed = handle
                    handle.fail(error)
                    self._cancel_waiting(MoveCancelled(f"Cancelled: {handle.what} failed before it ({error})."))
                    if unsafe:
                        self._stop_surely()  # what it had begun would go on, and nobody would look at it
                else:
                    self._current = None
                    handle.finish(result)
        except asyncio.CancelledError:
            if self._worker is me:  # not by `interrupt`: the event loop ends
                self.interrupt(MoveCancelled(f"Cancelled: the event loop of {self._name} ended."))
            raise
        finally:
            if self._worker is me:
                self._worker = None

    def _stop_surely(self) -> None:
        try:
            self._stop()
        except Exception:
            _log.exception("%s could not be stopped", self._name)

    def _cancel_waiting(self, error: Exception) -> None:
        self._upset()
        waiting, self._waiting = self._waiting, deque()
        for handle, _ in waiting:
            handle.fail(error)


def _as_told(handle: Handle[Any], error: Exception) -> MotionError:
    """What a command failed of that nobody foresaw, most likely in what the family says of its drive."""
    failed = MotionError(f"{handle.what} ended for an error in the program, most likely in its family: {error!r}")
    failed.__cause__ = error
    return failed


def _of_a_motion(handle: Handle[Any], error: BusError, *, stopped: bool) -> BusError:
    """What a command failed of. It is not said that nothing was done where it has set the axis in motion; it is said
    where the axis was stopped because it failed."""
    asking = isinstance(error, NotSent) or (isinstance(error, DeviceRefused) and is_read(error.request))
    if not asking or isinstance(error, MotionError):
        return error
    told = str(error).replace(" Nothing was done.", "")
    if isinstance(handle, Move) and handle.started_at is not None:
        failed: BusError = MoveFailed(f"{handle.what} was begun, and ended when its drive could not be asked: {told}")
    elif stopped:
        failed = copy.copy(error)
        failed.args = (f"{told} The axis turned before, and was stopped.",)
    else:
        return error
    failed.__cause__ = error
    return failed
