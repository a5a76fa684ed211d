"""Measures in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from rs485bus.sim import VirtualClockLoop

T = TypeVar("T")


def now() -> float:
    """The time on the loop's clock."""
    return asyncio.get_running_loop().time()


def on_virtual_clock(main: Coroutine[Any, Any, T]) -> T:
    """What a coroutine gives on a loop whose clock is virtual."""
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        return runner.run(main)
