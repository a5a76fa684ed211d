"""Real programs as the other side. Each test says which one it needs."""

from __future__ import annotations

import asyncio
import shutil
import socket
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

PACKAGES = {"mbpoll": "mbpoll", "socat": "socat", "ser2net": "ser2net", "gcc": "gcc libmodbus-dev"}


def needs(*programs: str) -> pytest.MarkDecorator:
    """Skip where a program is missing, and say which package has it."""
    missing = [program for program in programs if shutil.which(program) is None]
    packages = " ".join(PACKAGES[program] for program in missing)
    return pytest.mark.skipif(bool(missing), reason=f"{', '.join(missing)} is missing: sudo apt-get install {packages}")


posix = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals on Windows")


def free_port() -> int:
    """A TCP port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def in_real_time(main: Callable[[], Coroutine[Any, Any, None]], within: float = 60.0) -> None:
    """Run a test that needs real time, and give up on it rather than hang."""
    asyncio.run(asyncio.wait_for(main(), within))


async def run(*command: str, within: float = 20.0) -> str:
    """Run a program to its end; return what it printed."""
    process = await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    output, _ = await asyncio.wait_for(process.communicate(), within)
    text = output.decode()
    assert process.returncode == 0, text
    return text


@asynccontextmanager
async def running(*command: str, ready: str | None = None) -> AsyncIterator[asyncio.subprocess.Process]:
    """A program that runs while the block does; wait for what it prints when it is ready."""
    process = await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    try:
        assert process.stdout is not None
        if ready is not None:
            said = line = b""
            while ready not in line.decode():
                line = await asyncio.wait_for(process.stdout.readline(), 20)
                said += line
                assert line, f"{command[0]} ended before it was ready: {said.decode()}"
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


@asynccontextmanager
async def null_modem(folder: Path) -> AsyncIterator[tuple[str, str]]:
    """Two pseudo-terminals that socat ties together."""
    ends = folder / "one", folder / "other"
    async with running("socat", *(f"pty,rawer,link={end}" for end in ends)):
        for _ in range(200):
            if all(end.exists() for end in ends):
                break
            await asyncio.sleep(0.02)
        yield str(ends[0]), str(ends[1])
