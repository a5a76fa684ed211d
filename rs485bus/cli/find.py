"""`rs485bus ports` and `rs485bus scan`: what people and programs see of them."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path

from rich import box
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from rs485bus.bench.ports import serial_ports
from rs485bus.bench.scan import ADDRESSES, RATES, Format, Found, PortOf, Progress, Scan
from rs485bus.cli.outputs import check_output
from rs485bus.cli.process import DONE, FAILED, WrongUse, console
from rs485bus.cli.virtual import VIRTUAL, virtual_drives
from rs485bus.sim import VirtualLine

NOTHING = (
    "Nobody answers. Look at, in this order: the drive's power; A and B, which may be swapped (swapping them breaks "
    "nothing); the ground wire; the address and the baud rate in its menu or on its switches; at an MKS drive the menu "
    "item MB_RTU, which must be on; the adapter (rs485bus ports). All usual rates are tried without --baudrate."
)


def show_ports(as_json: bool) -> None:
    """Print the serial ports."""
    ports = serial_ports()
    if as_json:
        print(json.dumps([port.as_json() for port in ports], indent=2))
        return
    out = console()
    if not ports:
        out.print(
            "No serial port is plugged in. Plug the USB adapter in; if it is, dmesg | tail tells what the system makes "
            "of it. Without hardware: rs485bus sim puts virtual drives on a pseudo-terminal."
        )
        return
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("port", "what", "held by", "latency", "by-id"):
        table.add_column(heading, overflow="fold")
    for port in ports:
        latency = "" if port.latency_ms is None else f"{port.latency_ms} ms"
        table.add_row(port.port, port.description, ", ".join(port.held_by) or "-", latency, port.by_id or "")
    out.print(table)
    for port in ports:
        for advice in port.advice:
            out.print(f"{port.port}: {advice}")


def check_target(write: Path | None, force: bool) -> None:
    """Refuse to replace a plant file unasked, or one that cannot be written. Raises `WrongUse`."""
    if write is not None and write.is_file() and not force:
        raise WrongUse(f"{write} is there already: name another file, or replace it with --force.")
    check_output(write)


async def run_scan(
    port: str | None,
    baudrates: list[int] | None,
    formats: list[str] | None,
    addresses: str,
    expect: int | None,
    write: Path | None,
    as_json: bool,
    sim: bool,
) -> int:
    """Scan a port and show what is found. Returns the exit code: 1 where nobody answers."""
    if port is None and not sim:
        there = [found.port for found in serial_ports()]
        raise WrongUse(
            f"Say which port: rs485bus scan {there[0] if there else '/dev/ttyUSB0'}. "
            + (f"There is: {', '.join(there)}." if there else "None is plugged in. --sim scans virtual drives.")
        )
    scan = Scan(
        port=_virtual_port() if port is None else port,
        baudrates=baudrates or RATES,
        formats=[Format.parse(form) for form in formats or ["8N1"]],
        addresses=parse_addresses(addresses),
        expect=expect,
    )
    out = Console(stderr=True, highlight=False) if as_json else console()
    try:
        await say_progress(scan, out)
    except asyncio.CancelledError:
        _show(scan, as_json, out, "Interrupted: this was found so far.")
        raise
    _show(scan, as_json, out)
    if scan.found and write is not None:
        _write(write, port or VIRTUAL, scan.found, out)
    return DONE if scan.found else FAILED


def parse_addresses(text: str) -> list[int]:
    """Read "1-20,32".

    Raises:
        WrongUse: it cannot be read, or an address is outside 1..247.
    """
    found: set[int] = set()
    for part in text.split(","):
        low, dash, high = part.strip().partition("-")
        try:
            first, last = int(low), int(high if dash else low)
        except ValueError:
            raise WrongUse(f"addresses {text!r} cannot be read; write them like 1-20,32") from None
        if first not in ADDRESSES or last not in ADDRESSES:
            raise WrongUse(f"addresses {text!r} are outside 1..247")
        if first > last:
            raise WrongUse(f"addresses {part.strip()!r} are the wrong way round: {last}-{first}")
        found |= set(range(first, last + 1))
    return sorted(found)


async def say_progress(scan: Scan, out: Console) -> None:
    """Run a scan; on a terminal, show how far it is."""
    if not out.is_terminal:
        await scan.run()
        return
    with Live(console=out, refresh_per_second=8, transient=True) as live:

        def tell(progress: Progress) -> None:
            live.update(_progress(progress))

        scan.tell = tell
        await scan.run()


def _progress(progress: Progress) -> Text:
    left = progress.left
    time = "" if left is None else f", {left:.0f} s left"
    found = ", ".join(f"{one.title} {one.address}" for one in progress.found) or "nobody yet"
    share = 100 * progress.done // max(1, progress.total)
    return Text(f"{progress.line}, address {progress.address} ({share} %{time}; Ctrl-C ends it): {found}")


def _show(scan: Scan, as_json: bool, out: Console, before: str = "") -> None:
    if as_json:
        print(json.dumps([one.as_json() for one in scan.found], indent=2))
    if before:
        out.print(before)
    for skipped in scan.skipped:
        out.print(f"Not tried: {skipped}")
    if not scan.found:
        out.print(NOTHING)
        if scan.noise:
            out.print(
                f"{scan.noise} bytes were heard that are no answer: at a wrong rate drives may answer so, a pair "
                "without termination or bias makes them, or another program talks on it.",
            )
        return
    if not as_json:
        out.print(_table(scan.found))
    for one in scan.found:
        if one.note:
            out.print(f"Address {one.address}: {one.note}.")
    rates = {(one.baudrate, one.format) for one in scan.found}
    if len(rates) > 1:
        out.print("They are at different rates: one pair has one. rs485bus setup changes a drive's.")


def _table(found: list[Found]) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("address", "drive", "family", "bit/s", "format", "version", "answers after"):
        table.add_column(heading, justify="right" if heading in ("address", "bit/s", "answers after") else "left")
    for one in found:
        reply = "" if one.reply_ms is None else f"{one.reply_ms:g} ms"
        title = f"{one.title} [red](twins?)[/red]" if one.twins else one.title
        table.add_row(
            str(one.address), title, one.family or "-", str(one.baudrate), str(one.format), one.version or "", reply
        )
    return table


def _write(path: Path, port: str, found: list[Found], out: Console) -> None:
    from rs485bus.bench.first_file import first_plant_file

    if not any(one.family for one in found):
        out.print("No plant file was written: none of them is a drive that is known.")
        return
    path.write_text(first_plant_file(port, found, path.stem), encoding="utf-8")
    print(f"{path} is written. Next: rs485bus check {path}", file=sys.stderr)


def _virtual_port() -> PortOf:
    drives = virtual_drives()
    return lambda settings: VirtualLine(
        *drives, baudrate=settings.baudrate, parity=settings.parity, stopbits=settings.stopbits
    )
