"""The command: every slave, or those named. It ends with 1 where anything was wrong."""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys
import tempfile
from pathlib import Path

from tests.real.counterparts.slaves import SLAVES, Missing
from tests.real.counterparts.trial import trial


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.real.counterparts", description=__doc__)
    parser.add_argument("slaves", nargs="*", default=list(SLAVES), help=", ".join(SLAVES))
    parser.add_argument("--requests", type=int, default=10_000)
    parser.add_argument("--restarts", type=int, default=3)
    given = parser.parse_args()
    logging.getLogger("rs485bus").setLevel(logging.ERROR)  # ports are lost on purpose
    failed = 0
    for name in given.slaves:
        with tempfile.TemporaryDirectory() as folder:
            try:
                result = asyncio.run(trial(SLAVES[name], Path(folder), given.requests, given.restarts))
            except Missing as missing:
                print(f"{name}: NOT TRIED, {missing}", flush=True)
                continue
        print(f"{name}: {result}", flush=True)
        failed += result.wrong > 0 or result.answered < 0.9 * result.requests
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
