"""Virtual time for a test."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Coroutine
from types import TracebackType
from typing import Any, TypeVar

import pytest

from rs485bus.blocking.loop import shared_loop
from rs485bus.sim import VirtualClockLoop

T = TypeVar("T")


class VirtualClock:
    """Runs coroutines in virtual time, and blocking buses beside them. Made by the fixture `virtual_clock`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._patch = monkeypatch
        self._runner = asyncio.Runner(loop_factory=VirtualClockLoop)
        self._loops: list[asyncio.AbstractEventLoop] = []

    def run(self, main: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end, and return its result. Time jumps to the next event instead of passing."""
        loop = self._runner.get_loop()
        if loop not in self._loops:
            self._loops.append(loop)
        return self._runner.run(main)

    def time(self) -> float:
        """The virtual time, in seconds: that of the event loop that has come furthest."""
        return max((loop.time() for loop in self._loops), default=0.0)

    def __enter__(self) -> VirtualClock:
        self._patch.setattr(shared_loop, "make", self._make)
        self._patch.setattr(time, "sleep", shared_loop.sleep)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._runner.close()

    def _make(self) -> asyncio.AbstractEventLoop:
        self._loops.append(VirtualClockLoop())
        return self._loops[-1]
