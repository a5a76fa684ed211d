"""Speeds that are told again and again, and stop when nobody tells them any more: the one place that knows how."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

from rs485bus.errors import NotSupported

_EVERY = 0.05


@asynccontextmanager
async def set_points(axis: Any, timeout: float) -> AsyncIterator[Callable[[float], None]]:
    """Set-points for an axis, in rpm: the newest one counts, and one older than `timeout` seconds stops the motor.

    It is `axis.stream`, where the axis has it.
    """
    async with contextlib.AsyncExitStack() as stack:
        try:
            setpoint = await stack.enter_async_context(axis.stream(timeout=timeout))
        except NotSupported:
            setpoint = None
        if setpoint is not None:
            yield setpoint
            return
    stream = _Runs(axis, timeout)
    task = asyncio.create_task(stream.follow())

    def tell(rpm: float) -> None:
        if task.done():
            task.result()  # it failed
        stream.tell(rpm)

    try:
        yield tell
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        await axis.stop()


class _Runs:
    """Set-points as runs, one after another."""

    def __init__(self, axis: Any, timeout: float) -> None:
        self._axis = axis
        self._timeout = timeout
        self._rpm = 0.0
        self._told_at = float("-inf")
        self._runs_at = 0.0

    def tell(self, rpm: float) -> None:
        """What is to be from now on."""
        self._rpm, self._told_at = rpm, asyncio.get_running_loop().time()

    async def follow(self) -> None:
        """Carry out the newest one."""
        loop = asyncio.get_running_loop()
        while True:
            rpm = self._rpm if loop.time() - self._told_at <= self._timeout else 0.0
            if rpm != self._runs_at:
                self._runs_at = rpm
                if rpm:
                    await self._axis.run(rpm)
                else:
                    await self._axis.stop()
            await asyncio.sleep(_EVERY)
