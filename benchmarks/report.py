"""The table as Markdown, and all of it as JSON."""

from __future__ import annotations

import json
import os
import platform
import sys
from dataclasses import asdict
from pathlib import Path

from benchmarks.clients.registry import LIBRARIES
from benchmarks.promises import Promise, promises
from benchmarks.summary import Runs, libraries_of, rows


def machine() -> dict[str, str]:
    """What it ran on."""
    model = ""
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text().splitlines()
        model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
    return {
        "processor": f"{os.cpu_count()} x {model or platform.processor() or platform.machine()}",
        "system": f"{platform.system()} {platform.release()}",
        "python": sys.version.split()[0],
    }


def versions() -> dict[str, str]:
    """What was measured."""
    return {name: library.version for name, library in LIBRARIES.items() if library.package and not library.missing}


def table(runs: Runs) -> str:
    """What was measured, with medians and what they lie between."""
    there = libraries_of(runs)
    lines = [f"| | {' | '.join(there)} |", f"|---|{'---|' * len(there)}"]
    for row in rows(runs):
        cells = " | ".join(row.cells.get(library, "") for library in there)
        lines.append(f"| {row.title} | {cells} |")
    return "\n".join(lines)


def verdict(kept: list[Promise]) -> str:
    """What must be so, and whether it is."""
    return "\n".join(f"{'kept  ' if promise.kept else 'BROKEN'}  {promise.what}: {promise.figure}" for promise in kept)


def write(runs: Runs, skipped: list[str], folder: Path) -> None:
    """Leave the table and the JSON in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = promises(runs)
    about = {"machine": machine(), "versions": versions(), "skipped": skipped}
    everything = {**about, "promises": [asdict(promise) for promise in kept], "runs": runs.runs}
    (folder / "results.json").write_text(json.dumps(everything, indent=1) + "\n")
    named = ", ".join(f"{name} {version}" for name, version in versions().items())
    head = f"{machine()['processor']}, {machine()['system']}, Python {machine()['python']}; {named}"
    (folder / "results.md").write_text(f"{head}\n\n{table(runs)}\n\n```\n{verdict(kept)}\n```\n")
