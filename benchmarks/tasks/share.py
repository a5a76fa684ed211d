"""One request after the other, as fast as the library goes: share of the limit, broken silences, CPU a request."""

from __future__ import annotations

import time
from collections.abc import Iterator

from benchmarks.clients.interface import AsyncClient, BlockingClient
from benchmarks.setting import READ_COUNT, WRITE_COUNT, Step, workload
from benchmarks.tasks.task import Result, Task

_WARM_UP = 0.15
"""Seconds before it counts."""
_REPLY_TIMEOUT = 0.5
_VALUES = list(range(1, WRITE_COUNT + 1))


class _Watch:
    """Says what to ask next, and counts what was answered in the measured time."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self.requests = 0
        self.seconds = 0.0
        self.cpu = 0.0

    def steps(self) -> Iterator[Step]:
        """The workload over and over: a while to warm up, then for the time to measure, in whole repetitions."""
        steps = workload(self._task.setting.units)
        warm = time.monotonic() + _WARM_UP
        while time.monotonic() < warm:
            yield from steps[:8]
        begun, cpu = time.monotonic(), time.process_time()
        while time.monotonic() < begun + self._task.seconds:
            yield from steps
            self.requests += len(steps)
        self.seconds = time.monotonic() - begun
        self.cpu = time.process_time() - cpu

    def result(self) -> Result:
        rate = self.requests / self.seconds
        return {
            "requests": self.requests,
            "share": rate / self._task.setting.limit,
            "cpu_us": 1e6 * self.cpu / self.requests,
        }


async def run(task: Task, client: AsyncClient) -> Result:
    watch = _Watch(task)
    await client.open(task.port, task.setting.baudrate, _REPLY_TIMEOUT)
    for step in watch.steps():
        if step.writes:
            await client.write(step.unit, 0, _VALUES)
        else:
            await client.read(step.unit, 0, READ_COUNT)
    await client.close()
    return watch.result()


def run_blocking(task: Task, client: BlockingClient) -> Result:
    watch = _Watch(task)
    client.open(task.port, task.setting.baudrate, _REPLY_TIMEOUT)
    for step in watch.steps():
        if step.writes:
            client.write(step.unit, 0, _VALUES)
        else:
            client.read(step.unit, 0, READ_COUNT)
    client.close()
    return watch.result()
