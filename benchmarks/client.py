"""A client's process: one library, one task. Started by the harness.

python -m benchmarks.client '{"library": "rs485bus", "name": "share", "port": "/dev/pts/3"}'
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from typing import Any, cast

from benchmarks.clients.interface import AsyncClient, BlockingClient
from benchmarks.setting import Setting
from benchmarks.tasks import faulty, idle, lossy, share, stop, virtual, waiting
from benchmarks.tasks.task import Result, Task

_VIRTUAL = {"watched": virtual.watched, "memory": virtual.memory}
_ASYNC = {"share": share.run, "faulty": faulty.run, "lossy": lossy.run, "stop": stop.run, "waiting": waiting.run}
_BLOCKING = {"share": share.run_blocking, "faulty": faulty.run_blocking, "lossy": lossy.run_blocking}


def perform(task: Task) -> Result:
    """Carry out a task."""
    if task.name in _VIRTUAL:
        return _VIRTUAL[task.name](task)
    if task.name == "idle":
        return asyncio.run(idle.run(task))
    if task.blocking:
        return _BLOCKING[task.name](task, cast(BlockingClient, task.client()))
    return asyncio.run(_ASYNC[task.name](task, cast(AsyncClient, task.client())))


def main() -> None:
    options: dict[str, Any] = json.loads(sys.argv[1])
    core = options.pop("core", None)
    if core is not None:
        os.sched_setaffinity(0, {core})
    task = Task(setting=Setting(**options.pop("setting", {})), **options)
    print(json.dumps(perform(task)))


if __name__ == "__main__":
    main()
