"""An event loop whose clock is virtual: time jumps to the next timer instead of passing.

    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        runner.run(main())

An hour of a simulated plant takes as long as its events take to compute. Nothing real may be waited for on it.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Mapping
from typing import Any


class _JumpingSelector(selectors.BaseSelector):
    """Looks for events without waiting; where the loop would wait, the time passes at once."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.held: Callable[[], bool] = lambda: False
        self._real = selectors.DefaultSelector()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None or (timeout > 0 and self.held()):
            return self._real.select(None)  # only a real event can go on from here
        events = self._real.select(0)
        if not events and timeout > 0:
            self.now += timeout
        return events

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._real.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._real.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._real.modify(fileobj, events, data)

    def close(self) -> None:
        self._real.close()

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._real.get_map()


class VirtualClockLoop(asyncio.SelectorEventLoop):
    """A `loop_factory` for `asyncio.Runner`.

    Where other threads have the loop do things, `hold` says when its time stands still until they do.
    """

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        super().__init__(self._jumping)

    def time(self) -> float:
        return self._jumping.now

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        """Wait for the loop's threads in real time: their end is no event of the virtual one."""
        self._executor_shutdown_called = True
        executor = self._default_executor  # type: ignore[attr-defined]
        if executor is not None:
            executor.shutdown(wait=True)

    def hold(self, held: Callable[[], bool]) -> None:
        """No time passes while `held` says so, and nothing happens: until another thread calls into the loop."""
        self._jumping.held = held

    def block(self, seconds: float) -> None:
        """Let time pass in which nothing runs: the computer is busy with something else."""
        self._jumping.now += seconds
