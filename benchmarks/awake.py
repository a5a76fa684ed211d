"""Keeps a core from falling asleep, at the lowest priority there is. Where the machine is virtual, waking one up takes
the host up to milliseconds, which would be measured as the client's. It costs the client nothing: whatever else is
ready to run goes before it.

    python -m benchmarks.awake 0
"""

from __future__ import annotations

import os
import sys


def main() -> None:
    os.sched_setaffinity(0, {int(sys.argv[1])})
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    parent = os.getppid()
    while os.getppid() == parent:
        for _ in range(100_000):
            pass


if __name__ == "__main__":
    main()
