"""`rs485bus sim`: virtual drives on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os

from rich.console import Console

from rs485bus.errors import NotSupported
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine

FAMILIES = {"MKS": SimMks, "ZLAC": SimZlac, "TL-R": SimTlr}


async def serve(baudrate: int, drives: dict[str, list[int]], link: str | None, console: Console) -> int:
    """Serve drives, given as addresses by the names in `FAMILIES`, until cancelled."""
    if os.name != "posix":
        raise NotSupported("A pseudo-terminal needs Linux or macOS. On Windows use a null-modem driver, or WSL.")
    devices = [FAMILIES[family](address) for family, addresses in drives.items() for address in addresses]
    line = VirtualLine(*devices, baudrate=baudrate)
    async with await line.serve_pty(link) as port:
        # The path alone on the first line, for scripts.
        print(port.path, flush=True)
        said = ", ".join(f"{family} {', '.join(map(str, some))}" for family, some in drives.items() if some)
        console.print(f"{said} at {baudrate} bit/s, 8N1. Interrupt with Ctrl-C.")
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            console.print(f"\n{line.pair.frames} frames, {line.pair.early_frames} of them before t3.5")
    return 0
