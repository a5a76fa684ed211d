"""`rs485bus sim`: virtual drives on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from contextlib import AsyncExitStack

from rich.console import Console

from rs485bus.errors import NotSupported
from rs485bus.sim import Machine, SimDevice, SimMks, SimTlr, SimZlac, TlrMachine, VirtualLine

_SWITCH = 2.0
"""Turns between where a drive begins and its home switch."""


def _mks(address: int) -> SimDevice:
    return SimMks(address, machine=Machine(home_switch=-_SWITCH))


def _tlr(address: int) -> SimDevice:
    return SimTlr(address, machine=TlrMachine(origin=(_SWITCH, _SWITCH + 0.1)))  # homing as shipped goes up to it


FAMILIES: dict[str, Callable[[int], SimDevice]] = {"MKS": _mks, "ZLAC": SimZlac, "TL-R": _tlr}
_SWITCHES = {
    "MKS": f"{_SWITCH:g} turns below the start of each MKS",
    "TL-R": f"{_SWITCH:g} turns above the start of each TL-R",
}


async def serve(
    baudrate: int, drives: dict[str, list[int]], link: str | None, console: Console, tap: str | None = None
) -> int:
    """Serve drives, given as addresses by the names in `FAMILIES`, until cancelled. `tap` is a link for who listens."""
    if os.name != "posix":
        raise NotSupported("A pseudo-terminal needs Linux or macOS. On Windows use a null-modem driver, or WSL.")
    devices = [FAMILIES[family](address) for family, addresses in drives.items() for address in addresses]
    for device in devices:
        device.baudrate = baudrate
    line = VirtualLine(*devices, baudrate=baudrate)
    async with AsyncExitStack() as served:
        port = await served.enter_async_context(await line.serve_pty(link))
        if tap is not None:
            await served.enter_async_context(await line.serve_tap(tap))
        # The path alone on the first line, for scripts.
        print(port.path, flush=True)
        said = ", ".join(f"{family} {', '.join(map(str, some))}" for family, some in drives.items() if some)
        console.print(f"{said} at {baudrate} bit/s, 8N1. Interrupt with Ctrl-C.")
        homes = [where for family, where in _SWITCHES.items() if drives.get(family)]
        if homes:
            console.print(f"home() finds a switch {', '.join(homes)}.")
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            console.print(f"\n{line.pair.frames} frames, {line.pair.early_frames} of them before t3.5")
    return 0
