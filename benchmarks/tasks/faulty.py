"""Reads and writes on a line that mangles what it carries, with callers that are cancelled now and then.

What was asked and what was told is written down; who answered what is known to the line, and compared afterwards.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import random
import time
from collections.abc import Iterator, Sequence

from benchmarks.clients.interface import AsyncClient, BlockingClient
from benchmarks.tasks.task import Result, Task

_REPLY_TIMEOUT = 0.1
_CALLERS = 8
_CANCELLED = 0.05
"""The part of the requests whose caller is cancelled."""
_PAUSE = 0.02
"""Seconds a caller waits after a failure."""


class Diary:
    """What was asked, and what was told."""

    def __init__(self, task: Task) -> None:
        self.rng = random.Random(task.seed)
        self.units = task.setting.units
        self.until = time.monotonic() + task.seconds
        self.requests = 0
        self.failed = 0
        self.cancelled = 0
        self.reads: list[tuple[int, int, int, float, list[int]]] = []
        """Unit, register, count, when it was asked, and what was told."""
        self.writes: list[tuple[int, int, bool]] = []
        """Unit, token, and whether it was told that it was done."""
        self._tokens = itertools.count(1)

    def asks(self) -> Iterator[Ask]:
        """What to ask next, until the time is over."""
        while time.monotonic() < self.until:
            self.requests += 1
            yield Ask(self, next(self._tokens))

    def result(self) -> Result:
        return {
            "requests": self.requests,
            "failed": self.failed,
            "cancelled": self.cancelled,
            "reads": self.reads,
            "writes": self.writes,
        }


class Ask:
    """One request, by chance."""

    def __init__(self, diary: Diary, token: int) -> None:
        rng = diary.rng
        self._diary = diary
        self.unit = rng.randint(1, diary.units)
        self.writes = rng.random() < 0.25
        self.register = rng.randrange(4)
        self.count = rng.randrange(2, 5)
        self.token = token
        self.cancel_after = rng.expovariate(20) if rng.random() < _CANCELLED else None
        self.asked_at = time.monotonic()

    @property
    def values(self) -> list[int]:
        return [self.token >> 16, self.token & 0xFFFF]

    def told(self, values: Sequence[int]) -> None:
        self._diary.reads.append((self.unit, self.register, self.count, self.asked_at, list(values)))

    def done(self, done: bool) -> None:
        self._diary.writes.append((self.unit, self.token, done))


async def run(task: Task, client: AsyncClient) -> Result:
    await client.open(task.port, task.setting.baudrate, _REPLY_TIMEOUT)
    diary = Diary(task)
    asks = diary.asks()

    async def one(ask: Ask) -> None:
        if not ask.writes:
            ask.told(await client.read(ask.unit, ask.register, ask.count))
            return
        done = False
        try:
            await client.write(ask.unit, ask.register, ask.values)
            done = True
        finally:
            ask.done(done)

    async def caller() -> None:
        for ask in asks:
            asking = asyncio.create_task(one(ask))
            try:
                done, _ = await asyncio.wait([asking], timeout=ask.cancel_after)
                if not done:
                    diary.cancelled += 1
                    asking.cancel()
                await asking
            except asyncio.CancelledError:
                pass
            except Exception:
                diary.failed += 1
                await asyncio.sleep(_PAUSE)

    await asyncio.gather(*(caller() for _ in range(_CALLERS)))
    with contextlib.suppress(Exception):
        await client.close()
    return diary.result()


def run_blocking(task: Task, client: BlockingClient) -> Result:
    client.open(task.port, task.setting.baudrate, _REPLY_TIMEOUT)
    diary = Diary(task)
    for ask in diary.asks():
        done = False
        try:
            if ask.writes:
                client.write(ask.unit, ask.register, ask.values)
                done = True
            else:
                ask.told(client.read(ask.unit, ask.register, ask.count))
        except Exception:
            diary.failed += 1
            time.sleep(_PAUSE)
        if ask.writes:
            ask.done(done)
    client.close()
    return diary.result()
