"""Ctrl-C at random moments, in blocking scripts and in a notebook's cells, on virtual drives.

python -m tests.blocking.ctrl_c --scripts 5000 --cells 5000 --seed 1

A script opens a bus, arms watchdogs, moves and asks, in virtual time. A cell does so in a kernel of Jupyter's, run by
nbclient, in real time; it is interrupted as the notebook's button does: now and then before its first line, or when it
has ended already. After each, every motor stands, every watchdog is off, nothing hangs, and no thread is left.

python -m tests.blocking.ctrl_c --scripts 0 --cells 0 --bare 100

runs cells that only compute, without this package, and says how many of them the kernel never answers: of that nothing
is ours.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import faulthandler
import os
import random
import signal
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

from rs485bus import blocking
from rs485bus.errors import MotionError
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine
from tests.blocking.support import virtual_time

HANGS = 120
"""Half seconds after which a script is taken to hang. A time for which the system stops the process counts for one:
a busy machine is no hang."""
_LEAST_RPM = 0.1
"""What a ZLAC8015D reports as the lowest speed."""


def moves(bus: blocking.Bus) -> None:
    """Two axes move, one after the other and at once, and are asked where they are."""
    x, y = bus.mks(1), bus.tlr(4)
    x.enable()
    y.enable()
    x.move_to(2, rpm=600)
    y.move_to(1).wait()
    for _ in x.move_by(-1).positions(every=0.05):
        y.position()
    x.run(300).wait()
    x.stop().wait()


def guarded(bus: blocking.Bus) -> None:
    """Moves in blocks: of a watchdog, of a move."""
    x, base = bus.mks(1), bus.zlac(3)
    with bus.watchdog(x, base, timeout=1.0, lease=5.0) as guard:
        x.enable()
        base.enable()
        with x.move_to(1) as move:
            guard.renew()
            base.run(30, 30).wait()
        move.wait()
        base.stop().wait()
        guard.report()


def grouped(bus: blocking.Bus) -> None:
    """A group arrives together."""
    x, y = bus.mks(1), bus.mks(2)
    group = bus.group(x=x, y=y)
    with bus.watchdog(x, y, timeout=1.0):
        group.enable().wait()
        group.move_to(x=2, y=1, duration=1.0).wait()
        group.move_by(x=-1, y=1)
        group.positions()


def computing(bus: blocking.Bus) -> None:
    """A motor turns while the program does something else."""
    x = bus.mks(1)
    x.enable().wait()
    x.run(300)
    x.position()
    until = time.perf_counter() + 0.02
    while time.perf_counter() < until:
        sum(range(100))
    x.stop()


SCRIPTS: tuple[Callable[[blocking.Bus], None], ...] = (moves, guarded, grouped, computing)


class Plant:
    """Four virtual drives on a line."""

    def __init__(self) -> None:
        mks, zlac, tlr = (SimMks(1), SimMks(2)), SimZlac(3, watchdog=0), SimTlr(4)
        self._watched = (*mks, zlac)
        self._moving = (*mks, tlr)
        self._wheels = tuple(wheel.motor for wheel in zlac.wheels)
        self.line = VirtualLine(*mks, zlac, tlr)

    def wrong(self, now: float) -> list[str]:
        """What is not as it should be when a program was interrupted."""
        turning = [f"{type(motor).__name__} turns" for motor in self._moving if motor.moving(now)]
        # Each stop begins the ramp of these anew: the last hundredths of a rpm are told by no register.
        turning += ["a wheel turns" for wheel in self._wheels if abs(wheel.rpm(now)) >= _LEAST_RPM]
        watched = [f"{type(drive).__name__} is watched" for drive in self._watched if drive.watchdog_ms]
        return turning + watched


@contextlib.contextmanager
def interrupted(after: float) -> Iterator[None]:
    """Ctrl-C, so many seconds from now, unless the block was left before."""
    left = threading.Event()
    main = threading.get_ident()

    def press() -> None:
        if not left.wait(after):
            signal.pthread_kill(main, signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    try:
        yield
    finally:
        left.set()
        thread.join()


@contextlib.contextmanager
def no_hang() -> Iterator[None]:
    """End the process, and show what its threads do, unless the block ends in time."""
    left = threading.Event()

    def watch() -> None:
        if not any(left.wait(0.5) for _ in range(HANGS)):
            faulthandler.dump_traceback()
            os._exit(1)

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        left.set()
        thread.join()


def run_script(script: Callable[[blocking.Bus], None], after: float) -> str:
    """Run one that is interrupted. Returns "done" or "interrupted", or what went wrong."""
    plant = Plant()
    ended = "done"
    loop: asyncio.AbstractEventLoop | None = None
    try:
        with no_hang(), interrupted(after), blocking.open_bus(plant.line) as bus:
            loop = bus._loop.loop  # type: ignore[attr-defined] # whose clock it is
            script(bus)
    except KeyboardInterrupt:
        ended = "interrupted"
    wrong = [] if loop is None else plant.wrong(loop.time())
    for thread in threading.enumerate():
        if thread.name == "rs485bus":  # Ctrl-C came before the block was entered: the bus is closed as nobody has it
            thread.join(5)
            wrong += ["its thread goes on"] * thread.is_alive()
    return ", ".join(wrong) or ended


def run_scripts(count: int, seed: int) -> Counter[str]:
    """Run scripts until so many were interrupted, each at a moment of its own. Returns how they ended."""
    draw = random.Random(seed)
    ends: Counter[str] = Counter()
    with virtual_time():
        lasts = dict.fromkeys(SCRIPTS, 3600.0)  # seconds that it takes, the shortest seen: a busy machine stretches it
        for script in SCRIPTS * 3:
            begun = time.perf_counter()
            run_script(script, 3600)
            lasts[script] = min(lasts[script], time.perf_counter() - begun)
        while ends["interrupted"] < count and ends.total() < 10 * count:
            script = draw.choice(SCRIPTS)
            ends[run_script(script, draw.uniform(0, lasts[script]))] += 1
    return ends


# In a kernel

_UNTIL_INTERRUPTED = 300.0
"""Seconds that a cell waits for the interrupt that comes in any case. A kernel of Jupyter's that is interrupted in its
own work, before the cell's first line or behind the last one, sends no reply to that cell: without a bus that looks
like a hang."""
_NO_ANSWER = 5.0
"""Seconds after which a cell that only computes is taken to be never answered."""
_CELLS, _CLOSES = 4, 3
"""How many kinds of cells there are, and which one closes its bus."""
PLANT = Plant()
BUS: blocking.Bus | None = None


def cell(which: int) -> None:
    """What a cell does: with a bus that stays open from cell to cell, or with one of its own."""
    global BUS  # noqa: PLW0603 - as a notebook's variables are
    print("begun", flush=True)
    if BUS is None or BUS.closed:
        BUS = blocking.open_bus(PLANT.line)
    x = BUS.mks(1)
    x.enable()
    x.run(300)
    if which == 0:
        x.move_to(0.2 if x.position() < 0.1 else 0, rpm=1500, acceleration=20000).wait()
    elif which == 1:
        with BUS.watchdog(x, timeout=1.0):
            x.run(200).wait()
            time.sleep(0.02)
            x.stop().wait()
    elif which == 2:
        x.run(200)
        time.sleep(0.02)
        x.stop()
    else:
        BUS.close()
        time.sleep(_UNTIL_INTERRUPTED)  # with no bus open, a signal after the cell would meet the kernel's own work


def press_once(info: object) -> None:
    """Ctrl-C in the kernel's own work, before the first line of a cell, and of no cell after that."""
    from IPython import get_ipython

    get_ipython().events.unregister("pre_run_cell", press_once)
    signal.raise_signal(signal.SIGINT)


def is_open() -> bool:
    """Whether a bus is open: an interrupt before the next cell's first line is ours then."""
    return BUS is not None and not BUS.closed


def seen(now: Callable[[], float] = time.monotonic) -> str:
    """What is wrong a moment after a cell was left, whether it was interrupted or not."""
    until = time.monotonic() + 3
    while (wrong := PLANT.wrong(now())) and time.monotonic() < until:
        time.sleep(0.01)
    if BUS is not None and not BUS.closed:
        with contextlib.suppress(MotionError):
            BUS.mks(1).stop().wait(5)
    return ", ".join(wrong) or "fine"


class Notebook:
    """A kernel of Jupyter's, and one cell after the other in it."""

    def __init__(self, timeout: float = _UNTIL_INTERRUPTED) -> None:
        import nbformat
        from nbclient import NotebookClient

        self._new_cell = nbformat.v4.new_code_cell
        self._notebook = nbformat.v4.new_notebook()
        where = {"metadata": {"path": str(_ROOT)}}
        self._client = NotebookClient(self._notebook, timeout=timeout, allow_errors=True, resources=where)
        self._number = 0

    @contextlib.asynccontextmanager
    async def kernel(self) -> AsyncIterator[None]:
        """A new kernel while a block runs. It is killed at the end, whatever it does."""
        async with self._client.async_setup_kernel(env={**os.environ, "PYTHONPATH": str(_ROOT)}):
            try:
                yield
            finally:
                await self._client.km.shutdown_kernel(now=True)

    async def execute(self, source: str, after: float | None = None, *, begun: bool = True) -> str:
        """Run a cell.

        Args:
            source: what is in it.
            after: seconds after which it is interrupted.
            begun: counted from when it has printed something, not from when it is sent.

        Returns:
            What it has printed, and the name of what it has raised.
        """
        cell = self._new_cell(source)
        self._notebook.cells[:] = [cell]
        self._number += 1
        run = asyncio.ensure_future(self._client.async_execute_cell(cell, 0, execution_count=self._number))
        if after is not None:
            while begun and not cell.outputs:  # noqa: ASYNC110 - nbclient tells nobody
                await asyncio.sleep(0.001)
            await asyncio.sleep(after)
            await self._client.km.interrupt_kernel()
        outputs = [output for output in (await run).outputs if output.get("name") != "stderr"]  # the log
        said = (output.get("text", "") or output.get("ename", "") for output in outputs)
        return "".join(said).removeprefix("begun\n")


async def run_cells(count: int, seed: int) -> Counter[str]:
    """Run so many cells in a kernel, each interrupted at a moment of its own. Returns how they ended."""
    draw = random.Random(seed)
    ends: Counter[str] = Counter()
    notebook = Notebook()
    async with notebook.kernel():
        assert not await notebook.execute("from tests.blocking import ctrl_c")
        is_open = False
        for _ in range(count):
            which = draw.randrange(_CELLS)
            closes = which == _CLOSES
            ended = await notebook.execute(
                f"ctrl_c.cell({which})", draw.uniform(0.0, 0.15), begun=closes or not is_open or draw.random() < 0.5
            )
            said, _, there = (await notebook.execute("print(ctrl_c.seen(), ctrl_c.is_open(), end='')")).rpartition(" ")
            is_open = there == "True"
            ends[(ended or "done") if said == "fine" else said] += 1
            if ends.total() % 250 == 0:
                print(f"{ends.total()} cells", flush=True)
    return ends


async def run_bare_cells(count: int, seed: int) -> Counter[str]:
    """Run cells without this package, each interrupted at a moment of its own, and a new kernel where one fails."""
    draw = random.Random(seed)
    ends: Counter[str] = Counter()
    while ends.total() < count:
        notebook = Notebook(_NO_ANSWER)
        async with notebook.kernel():
            while ends.total() < count:
                lasts = draw.uniform(0, 0.02)
                source = f"import time\nuntil = time.perf_counter() + {lasts}\nwhile time.perf_counter() < until: pass"
                try:
                    ended = await notebook.execute(source, draw.uniform(0, 0.02), begun=False)
                    ends["KeyboardInterrupt" if "KeyboardInterrupt" in ended else "done"] += 1
                except Exception as error:
                    ends[f"the kernel did not answer ({type(error).__name__})"] += 1
                    break
    return ends


_ROOT = Path(__file__).parent.parent.parent


def main() -> None:
    """Run the campaign, and say how all of it ended."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scripts", type=int, default=100)
    parser.add_argument("--cells", type=int, default=50)
    parser.add_argument("--bare", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has its background jobs ignore it
    begun = time.monotonic()
    for what, ends in (
        ("scripts", run_scripts(given.scripts, given.seed)),
        ("cells", asyncio.run(run_cells(given.cells, given.seed)) if given.cells else Counter()),
        ("cells without a bus", asyncio.run(run_bare_cells(given.bare, given.seed)) if given.bare else Counter()),
    ):
        print(f"{sum(ends.values())} {what}: {', '.join(f'{n} {end}' for end, n in ends.most_common())}", flush=True)
    print(f"{time.monotonic() - begun:.0f} s")


if __name__ == "__main__":
    main()
