"""What is asked in the wrong place, or with the wrong thing, is refused before a frame is sent; listening ends."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.errors import BusClosed, DeviceRefused, LimitExceeded, PortBusy, WatchdogNotSupported
from rs485bus.motion.axis import Axis
from rs485bus.motion.events import EventKind
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine
from rs485bus.wire.crc import crc
from tests.integration.support import bus_on, plant, virtual


def line() -> VirtualLine:
    return VirtualLine(SimMks(1), SimZlac(2), SimTlr(3))


@virtual
async def test_a_watchdog_block_refuses_the_axes_of_another_bus_and_arms_nothing_on_its_own() -> None:
    here, there = line(), line()
    async with open_bus(here) as bus, open_bus(there) as other:
        x, y, z = MksServo(bus, 1), MksServo(other, 1), Zlac8015d(other, 2)
        for axes in ((y,), (x, y), (z,), (x, z.left)):
            with pytest.raises(ValueError, match="is on another bus than the one that was to guard it"):
                bus.watchdog(*axes, timeout=1.0)
        assert (here.pair.frames, there.pair.frames) == (0, 0)
        async with bus.watchdog(x, timeout=1.0), other.watchdog(y, z, timeout=1.0):
            pass


@virtual
async def test_a_drive_that_is_too_busy_to_be_armed_is_not_said_to_have_no_watchdog() -> None:
    made = plant()
    (sim,) = made.sims
    receive = sim.receive

    def busy(frame: bytes, now: float) -> bytes | None:
        if frame[1:4] != b"\x10\0\x98":
            return receive(frame, now)
        body = bytes((1, 0x90, 6))
        return body + crc(body)

    sim.receive = busy  # type: ignore[method-assign]
    async with bus_on(made) as (bus, (x,)):
        with pytest.raises(DeviceRefused, match=r"busy .*Nothing was done. Ask again later") as refused:
            async with bus.watchdog(x, timeout=1.0):
                pass
        assert not isinstance(refused.value, WatchdogNotSupported)
        assert sim.watchdog_ms == 0


# Arguments


@virtual
async def test_a_bus_that_was_not_opened_is_named_where_a_facade_is_made() -> None:
    families: list[Callable[..., Any]] = [MksServo, Zlac8015d, TlrStepper]
    for make in families:
        for bus in (open_bus(line()), "/dev/ttyUSB0", None):
            with pytest.raises(TypeError, match=r"bus must be made like await open_bus\(\.\.\.\), not"):
                make(bus, 1)


@virtual
async def test_an_observer_that_cannot_be_called_is_refused() -> None:
    async with open_bus(line()) as bus:
        for observer in (None, "print", 1):
            with pytest.raises(TypeError, match="an observer must be a function that takes a record, not"):
                bus.subscribe(observer)  # type: ignore[arg-type] # the point of the test


@virtual
async def test_a_restart_is_not_begun_where_it_is_not_said_how_long_it_may_take() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        for verb in (x.restart, x.calibrate, x.factory_reset):
            for timeout in (None, "1", True, 1j):
                with pytest.raises(TypeError, match="timeout must be a finite number above 0"):
                    verb(timeout=timeout)
            for timeout in (0, -1, float("nan"), float("inf")):
                with pytest.raises(LimitExceeded, match="timeout must be a finite number above 0"):
                    verb(timeout=timeout)
        assert made.line.pair.frames == 0


# Who listens


def every(bus: Any) -> list[Axis]:
    return [MksServo(bus, 1), Zlac8015d(bus, 2).left, TlrStepper(bus, 3)]


async def kinds(axis: Axis) -> list[EventKind]:
    return [event.kind async for event in axis.events()]


@virtual
async def test_listening_to_an_axis_ends_with_the_bus_and_misses_nothing_until_then() -> None:
    async with open_bus(line()) as bus:
        axes = every(bus)
        listeners = [asyncio.create_task(kinds(axis)) for axis in axes]
        for axis in axes:
            await axis.enable()
            await axis.run(60)
        for axis in axes:
            axis.stop()
        await bus.aclose()
    async with asyncio.timeout(1.0):
        assert await asyncio.gather(*listeners) == [[EventKind.STOP]] * 3


@virtual
async def test_nobody_listens_to_an_axis_whose_bus_is_closed() -> None:
    async with open_bus(line()) as bus:
        axes = every(bus)
    for axis in axes:
        with pytest.raises(BusClosed):
            await anext(axis.events())


@virtual
async def test_who_ceases_to_listen_leaves_no_task_behind() -> None:
    async with open_bus(line()) as bus:
        (x, *_) = every(bus)
        await asyncio.sleep(0.1)
        before = len(asyncio.all_tasks())
        for _ in range(3):
            listener = asyncio.create_task(kinds(x))
            await asyncio.sleep(0.1)
            listener.cancel()
            await asyncio.wait([listener])
        await asyncio.sleep(0.1)
        assert len(asyncio.all_tasks()) == before


@virtual
async def test_a_pair_that_one_bus_holds_is_refused_to_another() -> None:
    pair = line()
    async with open_bus(pair) as bus:
        with pytest.raises(PortBusy, match="open already, by another bus of this program"):
            await open_bus(pair)
        await bus.unit(1).read_input_registers(0xF1)  # it goes on
    async with open_bus(pair) as bus:  # it was closed
        await bus.unit(1).read_input_registers(0xF1)
