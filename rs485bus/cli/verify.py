"""`rs485bus verify-watchdog`: what feeds a real drive's watchdog."""

from __future__ import annotations

from rich.console import Console

from rs485bus import MksServo, open_bus
from rs485bus.cli.process import DONE, FAILED, agrees
from rs485bus.devices.mks.verify import RPM, verify_watchdog
from rs485bus.sim import SimMks, VirtualLine


async def verify(port: str | None, baudrate: int, address: int, timeout: float, yes: bool, console: Console) -> int:
    """Run the test, if somebody agrees, and say what it means. Returns 0 if the watchdog can be relied on."""
    if not yes and not agrees(_question(port, address, timeout)):
        console.print("Nothing was moved.")
        return FAILED
    where = port or VirtualLine(SimMks(address), baudrate=baudrate)
    async with open_bus(where, baudrate=baudrate) as bus:
        servo = MksServo(bus, address, rpm=RPM)
        found = await verify_watchdog(servo, timeout, lambda text: console.print(f"  {text}"))
    console.print()
    if not found.trips:
        console.print("[red]The watchdog does NOT stop this drive.[/red] Do not rely on it: cut its power instead.")
    elif not found.reads_feed:
        console.print("[red]Reads do not feed this drive's watchdog[/red]: with bus.watchdog it would trip.")
    else:
        console.print("The watchdog stops this drive when it is left alone, and the heartbeats keep it fed.")
    if found.others_feed or found.broadcasts_feed:
        what = " and ".join(
            name
            for name, feeds in (("frames to others", found.others_feed), ("broadcasts", found.broadcasts_feed))
            if feeds
        )
        console.print(f"{what} feed it, too: on a busy bus it does not notice that only its own host is silent.")
    return DONE if found.protects else FAILED


def _question(port: str | None, address: int, timeout: float) -> str:
    """What is asked before anything moves."""
    drive = "The virtual drive" if port is None else f"MKS {address} on {port}"
    return f"{drive} will turn at {RPM} rpm, five times {3 * timeout:g} s. Is it alone and free to turn?"
