"""What one does with a blocking bus, in a script or in the cells of a notebook."""

import asyncio
import contextlib
import gc
import sys
import threading
import time
import warnings
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import anyio
import pytest

from rs485bus import blocking
from rs485bus.blocking.interrupts import interrupts as known_interrupts
from rs485bus.blocking.loop import Call, LoopThread
from rs485bus.errors import AddressInUse, BusClosed, DeviceRefused, LimitExceeded, MoveCancelled, WrongThread
from rs485bus.sim import SimMks, SimTlr, SimUnit, SimZlac, VirtualLine


@pytest.fixture
def line() -> VirtualLine:
    return VirtualLine(SimMks(1), SimMks(2), SimZlac(3), SimTlr(4), SimUnit(7, {0: 5, 1: 6}))


@pytest.fixture
def bus(line: VirtualLine) -> Iterator[blocking.Bus]:
    with blocking.open_bus(line) as bus:
        yield bus


def test_commands_act_when_called_and_are_waited_for_or_not(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    x.enable()
    x.home()
    move = x.move_to(2)
    assert not move.done()
    assert move.wait() == pytest.approx(2, abs=0.01)
    assert move.done()
    assert x.position() == pytest.approx(2, abs=0.01)


def test_leaving_the_block_waits_for_queued_moves(line: VirtualLine) -> None:
    with blocking.open_bus(line) as bus:
        x = bus.mks(1)
        x.enable()
        move = x.move_to(3)
    assert move.wait() == pytest.approx(3, abs=0.01)
    assert bus.closed


def test_an_exception_stops_what_moves_and_goes_on(line: VirtualLine) -> None:
    with pytest.raises(ZeroDivisionError), blocking.open_bus(line) as bus:
        x = bus.mks(1)
        x.enable().wait()
        move = x.move_to(1000)
        next(move.positions(every=0.5))
        _ = 1 / 0
    with pytest.raises(MoveCancelled):
        move.wait()
    assert bus.stopped[0].standing


def test_a_group_a_vehicle_and_plain_modbus(bus: blocking.Bus) -> None:
    x, y, base = bus.mks(1), bus.tlr(4), bus.zlac(3, reverse=(False, True))
    group = bus.group(x=x, y=y)
    group.enable().wait()
    move = group.move_to(x=1, y=2, duration=2)
    assert move.wait() == pytest.approx({"x": 1, "y": 2}, abs=0.01)
    assert move.moves["x"].done()
    base.enable().wait()
    vehicle = bus.vehicle(base, wheel_radius=0.1, track=0.4)
    vehicle.reset()
    vehicle.drive(0.2, 0.0).wait()
    for pose in vehicle.poses(every=0.1):
        if pose.x > 0.1:
            break
    vehicle.stop().wait()
    assert bus.unit(7).read_holding_registers(0, 2) == [5, 6]


def test_a_watchdog_block_is_entered_left_and_reports(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    with bus.watchdog(x, timeout=1.0, lease=2.0) as guard:
        x.enable().wait()
        guard.renew()
        assert guard.report()[0].address == 1


def test_a_move_is_a_block_and_its_positions_an_iterator(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    x.enable()
    with x.move_to(1) as move:
        positions = list(move.positions(every=0.1))
    assert positions == sorted(positions)
    with pytest.raises(KeyError), x.move_to(500) as move:
        raise KeyError
    with pytest.raises(MoveCancelled):
        move.wait()


def test_a_wait_with_a_timeout_leaves_the_move_alone(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    x.enable().wait()
    move = x.move_to(200_00, rpm=1)
    with pytest.raises(TimeoutError, match="goes on"):
        move.wait(timeout=0.05)
    assert not move.done()
    x.stop().wait()
    with pytest.raises(MoveCancelled):
        move.wait()


@pytest.mark.parametrize("timeout", ["1", True, float("nan"), pytest.param(10**400, id="huge")])
def test_a_wait_for_no_time_says_so(bus: blocking.Bus, timeout: Any) -> None:
    x = bus.mks(1)
    x.enable().wait()
    move = x.move_to(0.5)
    with pytest.raises((TypeError, LimitExceeded), match="timeout must be a number"):
        move.wait(timeout)
    assert move.wait() == pytest.approx(0.5)


def test_a_cell_can_be_run_twice_but_not_with_other_settings(bus: blocking.Bus) -> None:
    x = bus.mks(1, units_per_turn=8.0)
    assert bus.mks(1, units_per_turn=8.0) is x
    assert bus.mks(1) is x
    assert x.bus is bus
    with pytest.raises(AddressInUse, match="other settings"):
        bus.mks(1, units_per_turn=5.0)


def test_a_bus_that_was_closed_tells_what_it_counted_and_does_nothing(line: VirtualLine) -> None:
    with blocking.open_bus(line) as bus:
        x = bus.mks(1)
        x.position()
    assert bus.stats.units[1].requests > 0
    assert "closed" in repr(bus)
    for call in (x.stop, x.position, x.enable, lambda: bus.unit(7).read_coils(0)):
        with pytest.raises(BusClosed):
            call()


def test_errors_are_raised_where_the_call_is(bus: blocking.Bus) -> None:
    x = bus.mks(1, limits=(0, 10))
    with pytest.raises(LimitExceeded, match="outside its limits"):
        x.move_to(11)


def test_any_argument_may_be_named(bus: blocking.Bus) -> None:
    with pytest.raises(DeviceRefused, match="illegal function"):
        bus.unit(7).request(function=0x41, data=b"", reply=5)


@pytest.mark.parametrize("address", [True, 1.5, [1], None, "1"])
def test_an_address_that_is_none_is_not_taken_for_an_axis_that_is_known(bus: blocking.Bus, address: Any) -> None:
    assert bus.mks(1) is bus.mks(1)
    with pytest.raises(TypeError, match="address must be a whole number"):
        bus.mks(address)


def test_what_layers_tell_each_other_is_not_offered(bus: blocking.Bus) -> None:
    """A wheel that is told to stop with something that is none could not be stopped any more."""
    assert not {"call_at", "keep", "owner"} & set(dir(bus))
    assert not {"stop_with", "carry", "drop"} & set(dir(bus.zlac(3).left))
    with pytest.raises(AttributeError):
        bus.call_at(0, print)  # type: ignore[attr-defined]  # what is tried


def test_attributes_are_read_and_set(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    x.rpm = 120.0
    assert x.rpm == 120.0
    assert x.move_to(0.5) is not None
    with pytest.raises(AttributeError, match="'speed'"):
        x.speed = 3  # type: ignore[attr-defined]  # what is tried
    with pytest.raises(AttributeError, match="'speed'"):
        _ = x.speed  # type: ignore[attr-defined]  # the same


def test_any_thread_may_call(bus: blocking.Bus) -> None:
    axes = [bus.mks(1), bus.mks(2)]
    reached: list[float] = []

    def go(axis: blocking.Axis, to: float) -> None:
        axis.enable()
        reached.append(axis.move_to(to).wait())

    threads = [threading.Thread(target=go, args=(axis, to)) for to, axis in enumerate(axes, start=1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(reached) == pytest.approx([1, 2], abs=0.01)


def test_a_callback_gets_faces_and_must_not_wait(bus: blocking.Bus) -> None:
    x = bus.mks(1)
    told: list[object] = []

    def done(handle: blocking.Handle[None]) -> None:
        told.append(handle)
        try:
            x.position()
        except WrongThread as error:
            told.append(error)

    handle = x.enable()
    handle.add_done_callback(done)
    handle.wait()
    x.position()
    assert told[0] is handle
    assert "queue.Queue" in str(told[1])


def test_observers_are_called_until_that_is_ended(bus: blocking.Bus) -> None:
    seen: list[object] = []
    end = bus.subscribe(seen.append)
    bus.mks(1).position()
    end()
    count = len(seen)
    assert count > 0
    bus.mks(1).position()
    assert len(seen) == count


def test_a_bus_that_nobody_closed_is_closed_when_it_is_let_go(line: VirtualLine) -> None:
    bus = blocking.open_bus(line)
    loop = bus._loop
    with pytest.warns(ResourceWarning, match="was not closed"):
        del bus
    until = time.monotonic() + 5
    while loop.alive and time.monotonic() < until:
        time.sleep(0.01)
    assert not loop.alive


def test_buses_share_a_loop_so_that_groups_may_span_them() -> None:
    with blocking.open_bus(VirtualLine(SimMks(1))) as one, blocking.open_bus(VirtualLine(SimMks(1))) as two:
        group = one.group(x=one.mks(1), y=two.mks(1))
        group.enable()
        assert group.move_to(x=1, y=1).wait() == pytest.approx({"x": 1, "y": 1}, abs=0.01)


def test_a_notebook_shows_an_axis_and_a_bus(bus: blocking.Bus) -> None:
    shown = bus.mks(1)._repr_html_()
    assert "MKS 1" in shown
    assert "stalled" in shown
    assert "unit 1" in bus._repr_html_()
    assert "ZLAC 3" in bus.zlac(3)._repr_html_()


def test_the_end_of_the_bus_ends_its_thread(line: VirtualLine) -> None:
    with blocking.open_bus(line):
        assert any(thread.name == "rs485bus" for thread in threading.enumerate())
    assert not any(thread.name == "rs485bus" for thread in threading.enumerate())


def test_a_timeline_is_a_figure_of_the_latest_transactions(bus: blocking.Bus) -> None:
    pytest.importorskip("matplotlib")
    bus.mks(1).position()
    figure = bus.timeline()
    assert len(figure.axes) >= 3


PLANT = """
[buses.line]
port = "/dev/ttyUSB0"
baudrate = 115200

[axes.x]
bus = "line"
family = "mks"
address = 1
watchdog = 1.0
"""


def test_a_plant_file_opens_its_buses_and_names_its_axes(tmp_path: Path) -> None:
    pytest.importorskip("pydantic")
    (tmp_path / "plant.toml").write_text(PLANT)
    with blocking.Plant.load(tmp_path / "plant.toml", sim=True) as plant:
        plant.x.enable()
        plant.x.move_to(1).wait()
        assert plant.x.position() == pytest.approx(1, abs=0.01)
        (report,) = plant.emergency_stop().values()
        assert report.all_standing


def test_a_bus_that_was_left_by_an_exception_is_kept_by_nobody() -> None:
    def interrupted() -> weakref.ref[blocking.Bus]:
        with contextlib.suppress(KeyboardInterrupt), blocking.open_bus(VirtualLine(SimMks(1))) as bus:
            bus.mks(1).run(300)
            raise KeyboardInterrupt
        return weakref.ref(bus)

    left = interrupted()
    gc.collect()
    assert left() is None


def test_threads_may_close_a_bus_at_once_and_the_others_go_on(bus: blocking.Bus) -> None:
    other = blocking.open_bus(VirtualLine(SimMks(1)))
    together = threading.Barrier(4)

    def close() -> None:
        together.wait()
        other.close()

    with ThreadPoolExecutor(4) as threads:
        closings = [threads.submit(close) for _ in range(4)]
    assert [closing.exception() for closing in closings] == [None] * 4
    assert bus.mks(1).position() == 0.0


def test_the_end_of_the_program_waits_until_the_motors_of_a_bus_that_was_let_go_stand() -> None:
    drive = SimMks(1)
    bus = blocking.open_bus(VirtualLine(drive))
    opened, now = bus._opened, bus._loop.loop.time
    bus.mks(1).enable()
    bus.mks(1).run(60).wait()
    with pytest.warns(ResourceWarning, match="was not closed"):
        del bus
    opened.close()  # as the end of the program does
    assert not drive.moving(now())


def test_what_waits_when_the_last_bus_is_closed_is_told_that(line: VirtualLine) -> None:
    bus = blocking.open_bus(line)
    begun = threading.Event()

    async def forever() -> None:
        begun.set()
        await asyncio.Event().wait()

    with ThreadPoolExecutor() as threads:
        waiting = threads.submit(bus._loop.call, forever)
        assert begun.wait(5)
        bus.close()
        assert isinstance(waiting.exception(5), BusClosed)


def test_buses_that_threads_open_and_close_at_once_are_all_known_to_ctrl_c() -> None:
    class Opened:
        def stop_soon(self) -> None: ...
        def press_again(self) -> None: ...
        def see_standing(self, give_up: Callable[[], bool]) -> None: ...

    interrupts = type(known_interrupts)()

    def open_and_close() -> None:
        for _ in range(2000):
            bus = Opened()
            interrupts.add(bus)
            assert bus in interrupts._buses
            interrupts.remove(bus)

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as threads:
            ended = [threads.submit(open_and_close) for _ in range(4)]
    finally:
        sys.setswitchinterval(interval)
    assert [thread.exception() for thread in ended] == [None] * 4
    assert not interrupts._buses


def test_a_call_that_begins_as_the_loop_ends_is_told_that_and_leaves_nothing_that_was_never_awaited() -> None:
    thread, begun, late = LoopThread(None), Call(anyio.sleep, (1,), {}), Call(anyio.sleep, (1,), {})
    soon = thread.loop.call_soon

    def end() -> None:
        thread._end.set_result(None)
        # In the last turn of the loop: what begins then has no turn of its own any more.
        for begin in (lambda: begun.begin(set()), lambda: Call(anyio.sleep, (1,), {}).begin(set())):
            soon(soon, begin)
        soon(soon, thread._begin, late)

    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        thread.post(end)
        thread._thread.join()
        gc.collect()
    assert not warned
    assert isinstance(begun.error, BusClosed)
    assert begun.ended.acquire(False)
    assert late.ended.locked()  # it has not begun, and who waits for it looks whether the loop runs
    with pytest.raises(BusClosed):
        thread.carry_out(Call(anyio.sleep, (1,), {}))
