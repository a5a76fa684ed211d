"""Measures how near this library and others come to the limit of the wire.

python -m benchmarks            all of it; takes an hour or so
python -m benchmarks --quick    a glance, in a minute or two
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks import report
from benchmarks.clients.registry import LIBRARIES
from benchmarks.lossy_cases import CASES
from benchmarks.measure import measure
from benchmarks.plan import QUICK, ROWS, Measurement, Scale
from benchmarks.processes import ClientFailed, awake
from benchmarks.promises import promises
from benchmarks.summary import Run, Runs


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a glance instead of a measurement")
    parser.add_argument("--rows", nargs="+", choices=list(ROWS), default=list(ROWS), help="measure only these")
    parser.add_argument("--libraries", nargs="+", choices=list(LIBRARIES), help="measure only these")
    parser.add_argument("--baudrates", nargs="+", type=int)
    parser.add_argument("--units", nargs="+", type=int)
    parser.add_argument("--repeats", type=int)
    parser.add_argument("--seconds", type=float, help="how long each share is measured")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), help="of lossy and dead, only these")
    parser.add_argument("--patience", type=float, default=2.0, help="seconds to wait for a quiet machine each time")
    parser.add_argument("--out", type=Path, default=Path("benchmark-results"), help="where the results go")
    options = parser.parse_args()
    scale = QUICK if options.quick else Scale()
    scale = replace(scale, **_chosen(options))
    skipped = [LIBRARIES[name].missing for name in scale.libraries if LIBRARIES[name].missing]
    for why in skipped:
        print("skipped:", why)
    scale = replace(scale, libraries=tuple(name for name in scale.libraries if not LIBRARIES[name].missing))
    plan = [measurement for row in options.rows for measurement in ROWS[row](scale)]
    if options.cases:
        plan = [measurement for measurement in plan if measurement.task.case in ("", *options.cases)]
    patience, attempts = (0.0, 1) if options.quick else (options.patience, 3)
    runs = Runs(carry_out(plan, patience, attempts, skipped))
    print()
    print(report.table(runs))
    print()
    print(report.verdict(promises(runs)))
    report.write(runs, skipped, options.out)
    try:
        from benchmarks.picture import draw

        draw(runs, options.out / "results.svg")
    except ImportError:
        print('no picture: it needs matplotlib, pip install "rs485bus[plot]"')
    print(f"\nThe results are in {options.out}/")
    return 0


def carry_out(plan: list[Measurement], patience: float, attempts: int, skipped: list[str]) -> list[Run]:
    """Measure one after the other. What fails is left out, and said."""
    runs: list[Run] = []
    with awake() as known, contextlib.suppress(KeyboardInterrupt):  # what was measured until then is reported
        for number, measurement in enumerate(plan, 1):
            task = measurement.task
            place: Run = {
                "row": measurement.row,
                "library": task.library,
                "baudrate": task.setting.baudrate,
                "units": task.setting.units,
                "amount": task.amount,
                "case": task.case,
                "repetition": measurement.repetition,
            }
            what = f"{measurement.row} {task.library} {task.setting.baudrate} baud"
            print(f"\r{number}/{len(plan)} {what:60}", end="", file=sys.stderr, flush=True)
            try:
                runs.append({**place, **measure(measurement, known, patience, attempts)})
            except ClientFailed as error:
                skipped.append(f"{what}: {error}")
                print(f"\nfailed: {what}: {error}", file=sys.stderr)
    print(file=sys.stderr)
    return runs


def _chosen(options: argparse.Namespace) -> dict[str, Any]:
    """What the command line says of the scale."""
    said = {name: getattr(options, name) for name in ("libraries", "baudrates", "units", "repeats", "seconds")}
    return {
        name: tuple(value) if isinstance(value, list) else value for name, value in said.items() if value is not None
    }


if __name__ == "__main__":
    sys.exit(main())
