"""`rs485bus jog`: keys as set-points."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.live import Live
from rich.text import Text

from rs485bus.bench.jog import Jog, keys_in
from rs485bus.cli.process import DONE, WrongUse, console
from rs485bus.cli.session import Where, axis_named, open_plant

_EVERY = 0.05
_TIMEOUT = 0.25
_HELP = "hold ← → (or a d): turn   ↑ ↓: speed   space: stop   e: enable again   q: end"


async def run_jog(where: Where, name: str, rpm: float) -> int:
    """Turn an axis by keys, until q. Returns the exit code."""
    if not sys.stdin.isatty() or os.name != "posix":
        raise WrongUse("jog reads keys from a terminal: run it in one (on Linux or macOS), not in a pipe.")
    name = axis_named(where.file(), name)
    async with open_plant(where) as plant:
        axis, unit = plant.axes[name], plant.file.axes[name].unit
        keys = Jog(rpm=min(rpm, axis.member.highest_rpm), fastest=axis.member.highest_rpm)
        await axis.enable()
        out = console()
        out.print(_HELP)
        loop = asyncio.get_running_loop()
        with _keys(keys), Live(console=out, refresh_per_second=10, transient=True) as live:
            while not keys.quits:
                async with axis.stream(timeout=_TIMEOUT) as setpoint:
                    while not keys.quits and not keys.wants_enable:
                        speed = keys.speed(loop.time())
                        setpoint(speed)
                        position, actual = await axis.position(), await axis.velocity()
                        state = keys.state(speed, actual, position, axis.limits, unit)
                        live.update(
                            Text(f"{name}  {position:10.3f} {unit}  {actual:8.1f} rpm  (set {keys.rpm:.0f})  {state}")
                        )
                        await asyncio.sleep(_EVERY)
                if keys.wants_enable:
                    keys.wants_enable = False
                    await axis.enable()
        out.print(f"{name} stands: {await axis.position():.3f} {unit}.")
    return DONE


@contextmanager
def _keys(jog: Jog) -> Iterator[None]:
    """Hand the keys of the terminal to a jog, each as it comes, without echo."""
    import termios
    import tty

    loop = asyncio.get_running_loop()
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal)

    def read() -> None:
        data = os.read(terminal, 1024)
        if not data:  # the terminal has gone
            jog.quits = True
            loop.remove_reader(terminal)
        for key in keys_in(data.decode(errors="replace")):
            jog.key(key, loop.time())

    loop.add_reader(terminal, read)
    try:
        yield
    finally:
        loop.remove_reader(terminal)
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
