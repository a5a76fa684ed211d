"""What the service must show, with a real mosquitto on this machine.

python -m benchmarks.service campaign      10,000 moves, while broker, service and connections are killed
python -m benchmarks.service hostile       clients that keep to no rule, while service and broker are killed
python -m benchmarks.service cuts          how long until an axis stands, when who commands it is gone
python -m benchmarks.service overtaking    an emergency stop by topic under a thousand messages a second
python -m benchmarks.service states        the state of twelve axes twenty times a second
python -m benchmarks.service many          fifty plants of eight axes at one broker
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys
import tempfile
import time
from pathlib import Path


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.service", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="what", required=True)
    campaign = commands.add_parser("campaign")
    campaign.add_argument("--moves", type=int, default=10_000)
    campaign.add_argument("--kills", type=int, default=10, help="of the broker and of the service, each")
    campaign.add_argument("--seed", type=int, default=0)
    hostile = commands.add_parser("hostile")
    hostile.add_argument("--seconds", type=float, default=120.0)
    hostile.add_argument("--seed", type=int, default=0)
    commands.add_parser("cuts").add_argument("--repeats", type=int, default=3)
    overtaking = commands.add_parser("overtaking")
    overtaking.add_argument("--stops", type=int, default=100)
    overtaking.add_argument("--rate", type=float, default=1000.0, help="messages a second meanwhile")
    commands.add_parser("states").add_argument("--seconds", type=float, default=60.0)
    many = commands.add_parser("many")
    many.add_argument("--plants", type=int, default=50)
    many.add_argument("--seconds", type=float, default=600.0)
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        holds = asyncio.run(_run(options, Path(folder)))
    print(f"{'holds' if holds else 'DOES NOT HOLD'}, after {time.monotonic() - began:.0f} s")
    return 0 if holds else 1


async def _run(options: argparse.Namespace, folder: Path) -> bool:
    match options.what:
        case "campaign":
            from benchmarks.service.campaign import campaign

            verdict = await campaign(folder, options.moves, options.kills, seed=options.seed)
            print(verdict)
            return verdict.holds
        case "hostile":
            from benchmarks.service.hostile import attack

            attacked = await attack(folder, options.seconds, options.seed)
            print(attacked)
            return attacked.holds
        case "cuts":
            from benchmarks.service.cuts import measure_all

            holds = True
            async for cut in measure_all(folder, options.repeats):
                print(cut, flush=True)
                holds &= cut.holds
            return holds
        case "overtaking":
            from benchmarks.service import overtaking

            overtaken = await overtaking.measure(folder, options.stops, options.rate)
            print(overtaken)
            return overtaken.holds
        case "states":
            from benchmarks.service import states

            told = await states.measure(folder, options.seconds)
            print(told)
            return told.holds
        case _:
            from benchmarks.service import many

            served = await many.measure(folder, options.plants, options.seconds)
            print(served)
            return served.holds


if __name__ == "__main__":
    sys.exit(main())
