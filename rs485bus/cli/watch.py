"""`rs485bus monitor` and `rs485bus record`: a plant that is watched."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import sys
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar

from rs485bus.bus.recording import KEEP, MAX_BYTES, Recording
from rs485bus.cli.outputs import check_output
from rs485bus.cli.process import DONE, FAILED, WrongUse, console
from rs485bus.cli.session import Where, open_plant
from rs485bus.errors import BusError
from rs485bus.extras import brought_by
from rs485bus.monitor.thread import BusThread, Watching
from rs485bus.monitor.watcher import Watcher
from rs485bus.plant import Plant

P = TypeVar("P")


def run_monitor(where: Where, record: Path | None) -> int:
    """Show a plant live, until q. Returns the exit code."""
    check_output(record)
    return show(lambda: _watched(where, record), lambda: where.file().name)


def show(opening: Callable[[], AbstractAsyncContextManager[Watching]], title: Callable[[], str]) -> int:
    """Show live what is watched, until q. Returns the exit code."""
    with brought_by("monitor", "textual", "The monitor needs"):
        from rs485bus.monitor.app import MonitorApp

    if not (sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()):
        raise WrongUse("monitor draws on a terminal and reads its keys: run it in one, not in a pipe.")
    if os.environ.get("TERM") == "dumb":
        raise WrongUse("monitor draws, and this terminal cannot (TERM=dumb). rs485bus record writes what happens.")
    with BusThread(opening) as buses:
        app = MonitorApp(buses, title())
        app.run()
    return app.return_code or DONE


async def run_record(where: Where, out: Path, *, every: float, seconds: float | None, max_bytes: int, keep: int) -> int:
    """Ask the axes of a plant again and again, and keep what happens in a capture. Returns the exit code."""
    check_output(out)
    return await record_until(
        open_plant(where, watchdogs=False, tells=False),
        lambda plant, stack: record_to(plant, out, stack, max_bytes=max_bytes, keep=keep),
        lambda plant: Watcher.of(plant, every),
        seconds,
    )


async def record_until(
    opening: AbstractAsyncContextManager[P],
    record: Callable[[P, AsyncExitStack], list[Recording]],
    watch: Callable[[P], Watching],
    seconds: float | None,
) -> int:
    """Have the axes of a plant asked, and keep what happens, for some seconds or until Ctrl-C.

    Args:
        opening: opens the plant.
        record: begins its recordings, which end with the stack.
        watch: makes what asks its axes.
        seconds: for how long; None for no end.

    Returns:
        The exit code.
    """
    recordings: list[Recording] = []
    try:
        async with opening as plant, AsyncExitStack() as stack:
            recordings += record(plant, stack)
            watcher = watch(plant)
            watcher.start()
            stack.push_async_callback(watcher.aclose)
            await tell_and_wait(recordings, seconds)
    except asyncio.CancelledError:
        tell_end(recordings)
        raise
    return tell_end(recordings)


async def tell_and_wait(recordings: list[Recording], seconds: float | None) -> None:
    """Say what is recorded, and wait for the end."""
    names = ", ".join(str(recording.path) for recording in recordings)
    until = "Ctrl-C ends it." if seconds is None else f"It takes {seconds:g} s."
    console().print(f"Recording to {names}. {until}", markup=False, soft_wrap=True)
    await asyncio.sleep(3600 * 24 * 365 if seconds is None else seconds)


def tell_end(recordings: list[Recording]) -> int:
    """Say what was recorded. Returns the exit code."""
    say = console()
    failed = False
    for recording in recordings:
        failed = failed or recording.error is not None or not recording.count
        lost = f" {recording.dropped} were lost: the disk is too slow." if recording.dropped else ""
        wrong = f" It ended early: {recording.error}" if recording.error else ""
        say.print(f"{recording.path}: {recording.count} entries.{lost}{wrong}", markup=False, soft_wrap=True)
    return FAILED if failed else DONE


def record_to(
    plant: Plant, out: Path, stack: AsyncExitStack, *, max_bytes: int = MAX_BYTES, keep: int = KEEP
) -> list[Recording]:
    """Record each bus of a plant: to `out`, or where there are several to one file each, named after the bus."""
    return [
        stack.enter_context(plant.buses[name].record_to(path, max_bytes=max_bytes, keep=keep))
        for name, path in paths(out, plant.buses).items()
    ]


def paths(out: Path, buses: Collection[str]) -> dict[str, Path]:
    """Where each bus is recorded to, by its name. Raises `WrongUse` where that cannot be written."""
    check_output(out)
    several = len(buses) > 1
    return {name: out.with_name(f"{out.stem}.{name}{out.suffix}") if several else out for name in buses}


def _watched(where: Where, record: Path | None) -> AbstractAsyncContextManager[Watcher]:
    @asynccontextmanager
    async def opening() -> AsyncIterator[Watcher]:
        async with open_plant(where, watchdogs=where.sim) as plant, AsyncExitStack() as stack:
            if record is not None:
                record_to(plant, record, stack)
            watcher = Watcher.of(plant)
            if where.sim:
                await stack.enter_async_context(to_and_fro(plant, watcher.stopped))
            yield watcher

    return opening()


@asynccontextmanager
async def to_and_fro(plant: Plant, stopped: Collection[str] = ()) -> AsyncIterator[None]:
    """Move the axes of a virtual plant, so that there is something to see; each until it is among those stopped."""
    moving = [asyncio.ensure_future(_to_and_fro(name, axis, stopped)) for name, axis in plant.axes.items()]
    try:
        yield
    finally:
        for task in moving:
            task.cancel()
        await asyncio.gather(*moving, return_exceptions=True)


async def _to_and_fro(name: str, axis: Any, stopped: Collection[str]) -> None:
    with contextlib.suppress(BusError):
        await axis.enable()
        for target in itertools.cycle((3.0 * axis.units_per_turn, 0.0)):
            if name in stopped:
                break
            await axis.move_to(target, rpm=60)
            await asyncio.sleep(1)
