"""`rs485bus explain`, `plot`, `pcap`: what is made of captures."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from rs485bus.bus.capture_lines import Exchange, Stray
from rs485bus.capture.reading import Capture, load, name_drives
from rs485bus.cli.outputs import check_output
from rs485bus.cli.telling import Teller, as_json, print_json, summary_json


def explain(
    capture: Capture,
    console: Console,
    *,
    units: Sequence[int],
    errors_only: bool,
    hexadecimal: bool,
    frames: bool,
    json: bool,
) -> int:
    """Say a capture in words. Returns the exit code."""
    from rs485bus.capture.statistics import summarise

    families = capture.families
    teller = Teller(console, families, hexadecimal=hexadecimal, errors_only=errors_only, units=units)
    summary = summarise(capture)
    if json:
        told = [
            as_json(exchange, families.get(exchange.address))
            for exchange in capture.exchanges
            if not units or exchange.address in units
        ]
        shown = [each for each in told if each["error"] or not errors_only] if frames else []
        strays = [{"at": round(stray.at, 6), "stray": stray.data.hex()} for stray in capture.strays]
        print_json({"exchanges": shown, "strays": strays, "summary": summary_json(summary, families)})
        return 0
    if frames:
        entries: list[Exchange | Stray] = [*capture.exchanges, *capture.strays]
        for entry in sorted(entries, key=lambda each: each.at):
            teller.tell(entry)
    teller.summary(summary)
    return 0


def read(
    files: Sequence[str],
    *,
    begin: float | None = None,
    end: float | None = None,
    drives: Sequence[tuple[str, Sequence[int]]] = (),
) -> Capture:
    """Read a capture for a command; say what of it could not be read.

    Raises:
        ValueError, OSError: it cannot be read; the message says what to do.
    """
    try:
        capture = load(*files)
    except FileNotFoundError as error:
        raise ValueError(f"There is no file {error.filename}. Make a capture with `rs485bus record`.") from None
    except IsADirectoryError as error:
        raise ValueError(f"{error.filename} is a folder: name a capture file in it.") from None
    for fault in capture.faults:
        print(fault, file=sys.stderr)
    name_drives(capture, drives)
    part = capture if begin is end is None else capture.between(begin, end)
    if not part.exchanges and not part.strays:
        between = (
            "" if begin is end is None else f" between {begin or 0:g} s and {end if end is not None else 'the end'}"
        )
        low, high = capture.span
        raise ValueError(f"{', '.join(files)}: nothing happened{between}. The capture spans {low:.3f} to {high:.3f} s.")
    return part


def pcap(capture: Capture, out: Path, console: Console) -> int:
    """Write a capture for Wireshark. Returns the exit code."""
    from rs485bus.capture.pcap import write_pcap

    check_output(out)
    count = write_pcap(capture, out)
    console.print(
        f"{out}: {count} packets. Wireshark shows them as Modbus RTU; with -o mbrtu.tcp.port:502 it also tells "
        "requests from replies where these are alike.",
        soft_wrap=True,
        markup=False,
    )
    return 0


def plot(capture: Capture, out: Path, console: Console, *, begin: float | None, end: float | None) -> int:
    """Draw a capture. Returns the exit code."""
    from rs485bus.capture.figures import check_format, save, timeline

    check_format(out)
    check_output(out)
    save(timeline(capture, begin=begin, end=end, title=""), out, capture)
    low, high = capture.span
    console.print(
        f"{out}: {len(capture.exchanges)} exchanges from {low:.3f} to {high:.3f} s.", markup=False, soft_wrap=True
    )
    return 0
