"""Running the command within the process of the tests: quick, and it behaves as in one of its own."""

from __future__ import annotations

import asyncio
import contextlib
import io
import queue
import threading
from collections.abc import Iterator
from dataclasses import dataclass

from rs485bus.cli.app import main
from rs485bus.sim import SimDevice, VirtualLine


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    returncode: int
    stdout: str
    stderr: str

    @property
    def said(self) -> str:
        """All that it said, on one line, without what frames it."""
        return " ".join((self.stdout + self.stderr).replace("│", " ").split())


def invoke(*arguments: str) -> Ended:
    """Run a command."""
    code = 0
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(arguments)
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 1
    return Ended(code, out.getvalue(), err.getvalue())


@contextlib.contextmanager
def serving(*drives: SimDevice, baudrate: int = 115200) -> Iterator[str]:
    """Virtual drives on a pseudo-terminal, served by a thread of their own. Gives the port's path."""
    ready: queue.Queue[tuple[str, asyncio.AbstractEventLoop, asyncio.Event]] = queue.Queue()

    async def serve() -> None:
        done = asyncio.Event()
        async with await VirtualLine(*drives, baudrate=baudrate).serve_pty() as port:
            ready.put((port.path, asyncio.get_running_loop(), done))
            await done.wait()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    path, loop, done = ready.get(timeout=20)
    try:
        yield path
    finally:
        loop.call_soon_threadsafe(done.set)
        thread.join(20)
