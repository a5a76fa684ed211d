"""Motion that somebody else began on the bus: what ends it is told, and what its owner does with it is no failure."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest

from benchmarks.virtual_clock import now, on_virtual_clock
from rs485bus import Bus, BusConfig, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.bus.opening import Opening
from rs485bus.devices.mks.values import Model, Status
from rs485bus.devices.zlac.values import ControlMode, ControlWord
from rs485bus.errors import BusError, MotionError, MotorStalled, NotEnabled
from rs485bus.motion.events import Event
from rs485bus.sim import SimDevice, SimMks, SimTlr, SimZlac, VirtualLine

RUN, STAND = (0xF6, [0x0000, 600]), (0xF6, [0x0000, 0])
"""What a plain client writes to an MKS drive: 600 rpm at once, and 0."""
Act = Callable[[Bus, MksServo, SimMks], Awaitable[None]]
HEAVY = 9999
"""mA that no motor has."""


def opened(sim: SimDevice, baudrate: int = 115200) -> Opening:
    return open_bus(VirtualLine(sim, baudrate=baudrate), baudrate=baudrate, config=BusConfig(echo=False))


async def listen(axis: Any, heard: list[Event]) -> None:
    async for event in axis.events():
        heard += (event,)


async def mks(act: Act, **options: Any) -> list[Event]:
    """An MKS axis that is enabled, of which the application does nothing; somebody else acts. What it was told."""
    sim = SimMks(1, model=Model.SERVO57D, **options)
    async with opened(sim, baudrate=38400) as bus:
        x = MksServo(bus, 1, model=Model.SERVO57D)
        await x.enable()
        heard: list[Event] = []
        listener = asyncio.create_task(listen(x, heard))
        await asyncio.sleep(0)
        await act(bus, x, sim)
        listener.cancel()
        return heard


def test_a_run_that_its_owner_ends_is_no_failure_and_the_bus_is_quiet_then() -> None:
    async def act(bus: Bus, x: MksServo, sim: SimMks) -> None:
        await bus.unit(1).write_registers(*RUN)
        await asyncio.sleep(1.0)
        await bus.unit(1).write_registers(*STAND)
        await asyncio.sleep(1.0)
        last = bus.flight[-1]
        await asyncio.sleep(10.0)
        assert bus.flight[-1] is last
        await x.move_by(0.1)

    assert on_virtual_clock(mks(act)) == []


def test_who_lets_go_of_the_motor_that_he_runs_is_not_told_so() -> None:
    async def act(bus: Bus, x: MksServo, sim: SimMks) -> None:
        await bus.unit(1).write_registers(*RUN)
        await asyncio.sleep(1.0)
        await bus.unit(1).write_register(0xF3, 0)
        await asyncio.sleep(1.0)
        await x.enable()

    assert on_virtual_clock(mks(act)) == []


def test_a_status_that_is_stuck_after_a_motion_is_no_held_shaft() -> None:
    async def act(bus: Bus, x: MksServo, sim: SimMks) -> None:
        await bus.unit(1).write_registers(*RUN)
        await asyncio.sleep(1.0)
        await bus.unit(1).write_registers(*STAND)
        await asyncio.sleep(3.0)
        await x.move_by(0.1)

    assert on_virtual_clock(mks(act, stuck_status=Status.SLOWING_DOWN)) == []


def test_a_held_shaft_is_stopped_and_does_not_turn_when_it_is_freed() -> None:
    async def act(bus: Bus, x: MksServo, sim: SimMks) -> None:
        await bus.unit(1).write_registers(*RUN)
        await asyncio.sleep(1.0)
        sim.put_load(HEAVY, now())
        sim.motion.stalled = False
        await asyncio.sleep(0.5)
        sim.put_load(0, now())
        freed = sim.shaft(now())
        await asyncio.sleep(1.0)
        assert sim.shaft(now()) == freed
        with pytest.raises(MotorStalled, match="something holds the shaft"):
            x.move_by(0.1)
        x.forgive()

    heard = on_virtual_clock(mks(act))
    assert heard[0].kind.value == "stall"


def test_a_status_that_is_stuck_at_full_speed_after_somebody_elses_motion_is_no_held_shaft() -> None:
    async def act(bus: Bus, x: MksServo, sim: SimMks) -> None:
        await bus.unit(1).write_registers(*RUN)
        await asyncio.sleep(1.0)
        await bus.unit(1).write_registers(*STAND)
        await asyncio.sleep(2.0)
        await x.move_by(0.1)  # it takes commands

    heard = on_virtual_clock(mks(act, stuck_status=Status.FULL_SPEED))
    assert not heard or any("stuck" in event.what for event in heard)
    assert "stall" not in [event.kind.value for event in heard]


@pytest.mark.parametrize("rate", [5, 20, 50])
def test_a_motor_that_stops_under_somebody_elses_stream_is_told_in_time(rate: int) -> None:
    async def act(bus: Bus, x: MksServo, sim: SimMks) -> None:
        begun = now()
        while now() < begun + 1.5:
            with suppress(BusError):  # it refuses once it is let go of
                await bus.unit(1).write_registers(*RUN)
            await asyncio.sleep(1 / rate)
            if now() > begun + 1.0:
                sim._enable(False, now())
        with pytest.raises(NotEnabled):
            x.move_by(0.1)
        x.forgive()

    assert on_virtual_clock(mks(act))


def test_a_program_that_says_a_speed_before_it_enables_its_wheels_is_not_stopped() -> None:
    async def main() -> None:
        sim = SimZlac(1)
        async with opened(sim) as bus:
            base, unit = Zlac8015d(bus, 1), bus.unit(1)
            await unit.write_register(0x200D, ControlMode.VELOCITY)
            await unit.write_register(0x2088, 60)
            await asyncio.sleep(1.0)  # time for a look
            await unit.write_register(0x200E, ControlWord.ENABLE)
            await asyncio.sleep(2.0)
            assert sim.rpm(now())[0] == pytest.approx(60, abs=1)
            await base.stop()

    on_virtual_clock(main())


def test_a_jog_of_somebody_else_that_an_input_stops_is_told() -> None:
    async def main() -> None:
        sim = SimTlr(1)
        async with opened(sim) as bus:
            x, unit = TlrStepper(bus, 1), bus.unit(1)
            await x.enable()
            await unit.write_registers(0x30, [60, 100, 100])
            await unit.write_register(0x4E, 0x08)
            await asyncio.sleep(1.0)
            sim.motion.stop(now())
            await asyncio.sleep(0.5)
            with pytest.raises(MotionError, match="has stopped in a motion that nobody here waits for"):
                x.move_by(0.1)
            x.forgive()

    on_virtual_clock(main())


def test_a_stall_is_told_of_a_motor_that_does_not_turn_and_not_of_one_whose_positions_show_that_it_does() -> None:
    async def act(bus: Bus, x: MksServo, sim: SimMks) -> None:
        await x.run(60)
        sim.motion.stalled = True  # and it turns on
        await asyncio.sleep(1.0)
        sim.motion.stalled = False
        await asyncio.sleep(1.0)
        sim.put_load(HEAVY, now())
        held = now()
        with suppress(MotionError):
            while now() < held + 0.6:
                await asyncio.sleep(0.01)
                x.check_ready()
        took.extend((held, now() - held))

    took: list[float] = []
    heard = on_virtual_clock(mks(act))
    told = [event.at for event in heard if event.kind.value == "stall"]
    assert len(told) == 1
    assert took[0] < told[0] < took[0] + 0.5
    assert took[1] < 0.5
