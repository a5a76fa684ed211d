"""A block of the asynchronous face that is open while a block of the blocking one runs."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from types import TracebackType
from typing import Any

from rs485bus.blocking.interrupts import blocks, calls, interrupts
from rs485bus.blocking.loop import Call, LoopThread

_Left = tuple[type[BaseException] | None, BaseException | None, TracebackType | None]


class Block:
    """Holds an asynchronous context manager open. It is entered and left by one task, as some of them demand.

    Its methods belong to the loop's thread.
    """

    def __init__(self, manager: AbstractAsyncContextManager[Any]) -> None:
        self._manager = manager
        self._task: asyncio.Task[bool | None] | None = None
        self._leaving: asyncio.Future[_Left] | None = None
        self.entered = False

    async def enter(self) -> Any:
        """Enter it. A cancellation ends that, or leaves it at once where it was entered in the same moment."""
        loop = asyncio.get_running_loop()
        self._leaving = loop.create_future()
        entered: asyncio.Future[Any] = loop.create_future()
        self._task = loop.create_task(self._hold(entered, self._leaving))
        try:
            await asyncio.wait([self._task, entered], return_when=asyncio.FIRST_COMPLETED)
        except asyncio.CancelledError as cancelled:
            if entered.done():
                await self.leave(type(cancelled), cancelled, None)
            else:
                self._task.cancel()
                await asyncio.wait([self._task])
                if not self._task.cancelled():
                    self._task.exception()  # seen: the cancellation is what is raised
            raise
        if not entered.done():
            return self._task.result()  # it was not entered, and says why
        self.entered = True
        return entered.result()

    async def leave(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        """Leave it, by an exception or without. Returns whether that is not to go on.

        One that is being left already is waited for.
        """
        task, leaving = self._task, self._leaving
        self.entered = False
        self._leaving = None  # the exception's frames are not to be kept
        if leaving is not None and not leaving.done():
            leaving.set_result((kind, error, trace))
        if task is None:
            return False
        await asyncio.wait([task])
        self._task = None
        return bool(task.result())

    async def _hold(self, entered: asyncio.Future[Any], leaving: asyncio.Future[_Left]) -> bool | None:
        entered.set_result(await self._manager.__aenter__())
        return await self._manager.__aexit__(*await leaving)


class BlockFace:
    """The blocking face of a context manager."""

    _inner: Any
    _loop: LoopThread
    _open: tuple[Block, ...] = ()

    def __enter__(self) -> Any:
        calls.depth += 1
        block = Block(self._inner)
        try:
            value = self._answer(self._loop.carry_out(Call(block.enter, (), {})))
            self._keep(block)
        except BaseException as error:
            if block.entered:
                self._part(block, error)
            raise
        finally:
            calls.depth -= 1
        # Ctrl-C comes between two instructions, but not between these few, none of which calls anything.
        if calls.pressed and not calls.depth:
            self._undo()
        return value

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        calls.depth += 1
        try:
            block, self._open = self._open[-1], self._open[:-1]
            return bool(self._loop.carry_out(Call(block.leave, (kind, error, trace), {}), patient=True))
        finally:
            calls.depth -= 1
            if calls.pressed and not calls.depth:
                interrupts.take_effect()

    def _keep(self, block: Block) -> None:
        object.__setattr__(self, "_open", (*self._open, block))

    def _answer(self, value: Any) -> Any:
        raise NotImplementedError  # what it is mixed into knows

    def _undo(self) -> None:
        """Leave the block that was just entered, by what Ctrl-C raises."""
        try:
            interrupts.take_effect()
        except BaseException as error:
            block, self._open = self._open[-1], self._open[:-1]
            self._part(block, error)
            raise

    def _part(self, block: Block, error: BaseException) -> None:
        leave: Callable[..., object] = block.leave
        with contextlib.suppress(Exception):  # what made it leave is what is raised
            self._loop.carry_out(Call(leave, (type(error), error, error.__traceback__), {}), patient=True)


blocks.add(BlockFace.__exit__.__code__)
