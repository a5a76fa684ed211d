"""Starts the line and the clients, each in a process of its own on a core of its own."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from benchmarks.tasks.task import Result, Task

_START = 30.0
_STOP = 30.0


class ClientFailed(Exception):
    """A client's process ended without a result; the message is its last words."""


def cores() -> tuple[int | None, int | None]:
    """The client's core and the line's; None where there is only one for both."""
    if not hasattr(os, "sched_getaffinity"):
        return None, None
    there = sorted(os.sched_getaffinity(0))
    return (there[0], there[-1]) if len(there) > 1 else (None, None)


class Process:
    """A line's process. `port` is what to open."""

    def __init__(self, module: str, options: dict[str, Any]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, json.dumps(options)],
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], _START)
        line = self._process.stdout.readline() if ready else ""
        if not line:
            self._process.kill()
            raise RuntimeError(f"{module} did not start")
        self.port = str(json.loads(line)["port"])
        self.pid = self._process.pid

    def stop(self) -> Result:
        """End it; return what it counted."""
        self._process.send_signal(signal.SIGTERM)
        out, _ = self._process.communicate(timeout=_STOP)
        counted: Result = json.loads(out) if out.strip() else {}
        return counted

    def kill(self) -> None:
        """End it, whatever it does."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()


@contextlib.contextmanager
def line(module: str, options: dict[str, Any]) -> Iterator[Process]:
    """A line while a block runs."""
    process = Process(module, options)
    try:
        yield process
    finally:
        process.kill()


@contextlib.contextmanager
def awake() -> Iterator[tuple[int, ...]]:
    """Keep the client's core awake while a block runs, where that is possible; gives the process that does."""
    core, _ = cores()
    if core is None or not hasattr(os, "SCHED_IDLE"):
        yield ()
        return
    process = subprocess.Popen([sys.executable, "-m", "benchmarks.awake", str(core)], start_new_session=True)
    try:
        yield (process.pid,)
    finally:
        process.kill()
        process.wait()


def run_client(task: Task, timeout: float = 120.0) -> Result:
    """Carry out a task in a process of its own.

    Raises:
        ClientFailed: it did not end well.
    """
    core, _ = cores()
    options = {**asdict(task), "core": core}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.client", json.dumps(options)],
            capture_output=True,
            text=True,
            timeout=timeout + task.seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ClientFailed(f"nothing within {timeout + task.seconds:.0f} s") from None
    if done.returncode:
        raise ClientFailed((done.stderr.strip().splitlines() or ["it said nothing"])[-1])
    result: Result = json.loads(done.stdout)
    return result
