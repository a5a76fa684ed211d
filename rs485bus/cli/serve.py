"""`rs485bus sim`: virtual drives on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os

from rich.console import Console

from rs485bus.errors import NotSupported
from rs485bus.sim import SimMks, VirtualLine


async def serve(baudrate: int, addresses: list[int], link: str | None, console: Console) -> int:
    """Serve until cancelled."""
    if os.name != "posix":
        raise NotSupported("A pseudo-terminal needs Linux or macOS. On Windows use a null-modem driver, or WSL.")
    line = VirtualLine(*(SimMks(address) for address in addresses), baudrate=baudrate)
    async with await line.serve_pty(link) as port:
        # The path alone on the first line, for scripts.
        print(port.path, flush=True)
        drives = ", ".join(map(str, addresses))
        console.print(f"MKS {drives} at {baudrate} bit/s, 8N1. Interrupt with Ctrl-C.")
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            console.print(f"\n{line.pair.frames} frames, {line.pair.early_frames} of them before t3.5")
    return 0
