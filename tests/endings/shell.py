"""The bus among tasks that are cancelled, callbacks that raise and a line that fails, on a virtual clock; and a judge.

python -m tests.endings.shell --examples 2000 --seed 1
python -m tests.endings.shell --only 17
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import re
import signal
import sys
import time
import traceback
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from typing import Any

from rs485bus.errors import BusError
from rs485bus.sim import VirtualClockLoop
from tests.endings.application import Application
from tests.endings.calls import LONGEST, REPLY_TIMEOUT, Boom


class _Listener(logging.Handler):
    def __init__(self, application: Application) -> None:
        super().__init__()
        self._application = application

    def emit(self, record: logging.LogRecord) -> None:
        self._application.logged.append(record.getMessage())


class _Stuck(BaseException):
    pass


def _too_long(number: int, frame: object) -> None:
    raise _Stuck


def run(seed: int) -> Application:
    """One application to its end."""
    application = Application(seed)
    application._later = []
    logger = logging.getLogger("rs485bus")
    listener = _Listener(application)
    logger.addHandler(listener)
    propagate, logger.propagate = logger.propagate, False
    loop = VirtualClockLoop()
    asyncio.set_event_loop(loop)

    def unhandled(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if not isinstance(error, (Boom, BusError, asyncio.CancelledError)) and "destroyed" not in context["message"]:
            trace = "" if error is None else "".join(traceback.format_tb(error.__traceback__)[-2:])
            application.fault(f"the loop was told: {context['message']} {error!r} {trace}"[:500])

    loop.set_exception_handler(unhandled)
    whole = loop.create_task(application.whole())
    guard = loop.call_later(250, loop.stop)
    signal.signal(signal.SIGALRM, _too_long)
    signal.setitimer(signal.ITIMER_REAL, 30)
    try:
        loop.run_until_complete(whole)
    except RuntimeError as error:
        if "stopped before" not in str(error):
            application.fault(f"raised {error!r}")
    except _Stuck:
        application.fault("it took 30 s of real time")
    except Exception as error:
        application.fault(f"raised {error!r} {''.join(traceback.format_tb(error.__traceback__)[-2:])}")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        guard.cancel()
        now = loop.time()
        logger.removeHandler(listener)
        logger.propagate = propagate
        asyncio.set_event_loop(None)
    for call in application.calls:
        longest = LONGEST if call.timeout is None else call.timeout + REPLY_TIMEOUT + 0.02
        took = (call.ended if call.ended is not None else now) - call.begun
        if call.ended is None:
            application.fault(f"{call.what} never ended (begun {call.begun - 1000:.3f}, now {now - 1000:.3f})")
        elif took > longest:
            application.fault(f"{call.what} took {took:.3f} s, allowed are {longest:.3f} ({call.how})")
    for task in asyncio.all_tasks(loop):
        task._log_destroy_pending = False  # type: ignore[attr-defined]
    with contextlib.suppress(Exception):
        loop.close()
    return application


def kind(fault: str) -> str:
    """A fault without its numbers."""
    return re.sub(r"-?\d+(\.\d+)?", "#", fault)[:100]


def some(seeds: range) -> tuple[Counter[str], list[tuple[int, str]]]:
    counts: Counter[str] = Counter()
    wrong: list[tuple[int, str]] = []
    for seed in seeds:
        application = run(seed)
        counts.update(application.counts)
        wrong += [(seed, fault) for fault in application.wrong]
    return counts, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--examples", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", type=int, help="run one again")
    options = parser.parse_args()
    if options.only is not None:
        application = run(options.only)
        cable, lying = application.cable, [drive.lies for drive in application.drives.values()]
        print(f"echo {cable.echo!r} gateway {cable.gateway} latency {cable.latency} lying {lying}")
        print(f"another program left the shafts turning: {application.for_foreign}")
        print(f"stopped {application.stop_asked}; {application.config}")
        for call in application.calls:
            ended = "-" if call.ended is None else f"{call.ended - 1000:.4f}"
            print(f"{call.begun - 1000:9.4f} {ended:>9} {call.what}: {call.how}")
        for line in application.logged:
            print("log:", line)
        for fault in application.wrong:
            print("wrong:", fault)
        return 1 if application.wrong else 0
    begun, first = time.perf_counter(), options.seed * 10_000_000
    size = max(1, min(50, options.examples // options.processes))
    chunks = [
        range(at, min(at + size, first + options.examples)) for at in range(first, first + options.examples, size)
    ]
    counts: Counter[str] = Counter()
    kinds: dict[str, list[tuple[int, str]]] = {}
    with ProcessPoolExecutor(options.processes) as pool:
        for counted, found in pool.map(some, chunks):
            counts.update(counted)
            for seed, fault in found:
                kinds.setdefault(kind(fault), []).append((seed, fault))
    print(f"{options.examples} examples in {time.perf_counter() - begun:.0f} s; {dict(sorted(counts.items()))}")
    for name, found in sorted(kinds.items(), key=lambda item: -len(item[1])):
        seeds = sorted({seed for seed, _ in found})
        print(f"{len(seeds)} examples: {name}\n    such as {found[0][1]}\n    seeds {seeds[:6]}")
    print(f"{len({seed for found in kinds.values() for seed, _ in found})} wrong")
    return 1 if kinds else 0


if __name__ == "__main__":
    sys.exit(main())
