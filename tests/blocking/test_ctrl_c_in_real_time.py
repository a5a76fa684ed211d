"""Ctrl-C in blocking scripts, threads and notebooks: the motors stop first."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from types import FrameType

import pytest

from rs485bus import blocking
from rs485bus.errors import MoveCancelled
from rs485bus.sim import SimMks, VirtualLine
from tests.blocking import ctrl_c


@pytest.fixture
def bus() -> Iterator[blocking.Bus]:
    with blocking.open_bus(VirtualLine(SimMks(1))) as bus:
        yield bus


def press_at_the_next_answer(bus: blocking.Bus) -> None:
    """Ctrl-C when the next answer comes, from whichever thread hears it."""
    main = threading.get_ident()
    pressed: list[None] = []

    def press(record: object) -> None:
        if not pressed:
            pressed.append(None)
            signal.pthread_kill(main, signal.SIGINT)
            time.sleep(0.05)  # the main thread has its turn before virtual time goes on

    bus.subscribe(press)


@pytest.mark.filterwarnings("ignore:.*finalize object.*:pytest.PytestUnraisableExceptionWarning")
def test_random_moments_in_scripts() -> None:
    ends = ctrl_c.run_scripts(20, 1)
    assert set(ends) <= {"interrupted", "done"}, ends
    assert ends["interrupted"] > 5


def test_random_moments_in_the_cells_of_a_notebook() -> None:
    ends = asyncio.run(ctrl_c.run_cells(4, 1))
    assert set(ends) <= {"KeyboardInterrupt", "done"}, ends


def test_a_press_before_the_first_line_of_a_cell_stops_the_motors_and_takes_effect_in_it() -> None:
    async def main() -> None:
        notebook = ctrl_c.Notebook(60)
        async with notebook.kernel():
            await notebook.execute("from tests.blocking import ctrl_c; ctrl_c.cell(2)")
            await notebook.execute("get_ipython().events.register('pre_run_cell', ctrl_c.press_once)")
            said = await notebook.execute(
                "ctrl_c.BUS.mks(1).run(300); import time; time.sleep(30); print('it went on')"
            )
            assert said == "KeyboardInterrupt"
            assert await notebook.execute("print(ctrl_c.seen(), ctrl_c.is_open())") == "fine True\n"

    asyncio.run(main())


def test_who_waits_sees_the_motor_stand_before_it_is_raised(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    x.enable().wait()
    move = x.move_to(1e4)
    next(move.positions())
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
        move.wait()
    assert x.idle()
    with pytest.raises(MoveCancelled):
        move.wait()


def test_in_code_that_does_something_else_it_stops_at_once_and_is_raised_there(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    x.enable().wait()
    x.run(300).wait()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    x.stop().wait()
    assert x.idle()


def test_a_handler_that_raises_nothing_lets_the_call_go_on_after_the_stop() -> None:
    pressed: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        pressed.append(number)

    former = signal.signal(signal.SIGINT, note)
    try:
        with blocking.open_bus(VirtualLine(SimMks(1))) as bus:
            x = bus.mks(1)
            x.enable().wait()
            move = x.move_to(1e4)
            next(move.positions())
            press_at_the_next_answer(bus)
            with pytest.raises(MoveCancelled):
                move.wait()
            assert pressed == [signal.SIGINT]
        assert signal.getsignal(signal.SIGINT) is note
    finally:
        signal.signal(signal.SIGINT, former)


class Pressed:
    """Ctrl-C comes while it is let go of."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def test_it_is_not_lost_where_python_ignores_what_is_raised(bus: blocking.Bus) -> None:
    pressed: Pressed | None = Pressed()
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        pressed = None
        time.sleep(5)
    assert pressed is None
    assert time.monotonic() - begun < 4  # it wakes who sleeps


def test_a_program_that_ignores_it_goes_on_ignoring_it() -> None:
    former = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with blocking.open_bus(VirtualLine(SimMks(1))) as bus:
            x = bus.mks(1)
            x.enable().wait()
            move = x.move_to(2)
            signal.raise_signal(signal.SIGINT)
            assert move.wait() == pytest.approx(2, abs=0.01)
    finally:
        signal.signal(signal.SIGINT, former)


def test_the_last_bus_puts_the_former_handler_back() -> None:
    former = signal.getsignal(signal.SIGINT)
    with blocking.open_bus(VirtualLine(SimMks(1))):
        with blocking.open_bus(VirtualLine(SimMks(1))):
            assert signal.getsignal(signal.SIGINT) is not former
        assert signal.getsignal(signal.SIGINT) is not former
    assert signal.getsignal(signal.SIGINT) is former


def test_a_block_that_is_being_left_is_left_whole(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    with pytest.raises(KeyboardInterrupt), bus.watchdog(x, timeout=1.0) as guard:
        x.enable().wait()
        x.run(300).wait()
        press_at_the_next_answer(bus)
    assert guard.report()[0].trips == 0
    with bus.watchdog(x, timeout=1.0):  # else it would be guarded already
        assert x.idle()


NO_BLOCK = """
import atexit, os, signal, sys, time
from rs485bus import blocking
from rs485bus.sim import SimMks, VirtualLine

sim = SimMks(1)
# What is registered first is called last: after the bus was closed.
atexit.register(lambda: print("moving", sim.moving(time.monotonic()), "watchdog", sim.watchdog_ms, flush=True))
bus = blocking.open_bus(VirtualLine(sim))
x = bus.mks(1)
guard = bus.watchdog(x, timeout=1.0)
guard.__enter__()
x.enable().wait()
x.run(300).wait()
assert sim.moving(time.monotonic())
"""
ENDS = {
    "at its last line": ("", 0),
    "by an exception": ("1 / 0", 1),
    "by sys.exit": ("sys.exit(3)", 3),
    "by Ctrl-C": ("os.kill(os.getpid(), signal.SIGINT); time.sleep(9)", 130),
}


@pytest.mark.parametrize("how", ENDS)
def test_a_script_without_a_block_leaves_no_motor_turning(how: str) -> None:
    end, code = ENDS[how]
    begun = time.monotonic()
    script = NO_BLOCK + end
    result = subprocess.run((sys.executable, "-c", script), capture_output=True, text=True, timeout=30, check=False)
    assert result.returncode in (code, -signal.SIGINT), result.stderr
    assert "moving False watchdog 0" in result.stdout, result.stdout + result.stderr
    assert time.monotonic() - begun < 20


def test_after_a_fork_the_child_is_told_whose_bus_it_is(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    read, write = os.pipe()
    if (child := os.fork()) == 0:
        try:
            x.stop()
        except BaseException as error:
            os.write(write, type(error).__name__.encode())
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(read, 100) == b"WrongThread"
    os.close(read)
    os.close(write)
    assert x.position() == pytest.approx(0, abs=0.01)
