"""`python -m tests.bench 50`: verify and tune find the options of so many virtual drives and pairs, drawn at random.

`python -m tests.bench mks 17` does one of them again.
"""

import asyncio
import random
import sys

from rs485bus.sim import VirtualClockLoop
from tests.bench.test_tune import check_tune
from tests.bench.test_verify import CHECKS as VERIFIED

CHECKS = {**VERIFIED, "tune": check_tune}


def main() -> int:
    """Run them; returns how many failed."""
    family, number = (sys.argv[1], int(sys.argv[2])) if len(sys.argv) > 2 else ("", int(sys.argv[1]))
    failed = 0
    for name in [family] if family else CHECKS:
        seeds = [number] if family else list(range(number))
        wrong = 0
        for seed in seeds:
            try:
                with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
                    runner.run(CHECKS[name](random.Random(seed)))
            except Exception as error:
                wrong += 1
                print(f"python -m tests.bench {name} {seed}: {type(error).__name__}: {str(error)[:200]}")
        failed += wrong
        print(f"{name}: {len(seeds) - wrong} of {len(seeds)} found")
    return failed


if __name__ == "__main__":
    sys.exit(min(1, main()))
