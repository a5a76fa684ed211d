"""What the service must show, with a real mosquitto on this machine.

python -m benchmarks.service campaign      10,000 moves, while broker, service and connections are killed
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
import time
from pathlib import Path


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.service", description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="what", required=True)
    campaign = commands.add_parser("campaign", help="moves, while broker, service and connections are killed")
    campaign.add_argument("--moves", type=int, default=10_000)
    campaign.add_argument("--kills", type=int, default=10, help="of the broker and of the service, each")
    campaign.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(_run(options, Path(folder)))


async def _run(options: argparse.Namespace, folder: Path) -> int:
    began = time.monotonic()
    from benchmarks.service.campaign import campaign

    verdict = await campaign(folder, options.moves, options.kills, seed=options.seed)
    print(f"{verdict}\n{time.monotonic() - began:.0f} s")
    return 0 if verdict.holds else 1


if __name__ == "__main__":
    sys.exit(main())
