"""A stream that somebody else stops has ended for who holds its block when the motor stands, and not before."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from rs485bus import AxisGroup, DifferentialDrive, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.errors import MoveCancelled, StopUnconfirmed
from rs485bus.service import verbs
from rs485bus.service.decisions import Halt, Order
from rs485bus.service.machine import Machine, Performance
from rs485bus.sim import SimMks, SimTlr, SimZlac, TlrMachine, VirtualLine
from tests.devices.stream_rig import FAMILIES, Make, now, rig
from tests.integration.support import virtual


class _Served:
    """Axes of one bus, as a plant that is served."""

    name, groups, vehicle = "cell", dict[str, Any](), None

    def __init__(self, bus: Any, **axes: Any) -> None:
        self.buses, self.axes = {"main": bus}, axes


def _opened(name: str = "x") -> Order:
    axes = frozenset({name})
    return Order("1", "a", name, "stream", verbs.Stream(timeout=1.0), axes, axes, 1, 0.0, 9e9, None, "")


async def _served(axis: Any) -> tuple[Machine, Performance, asyncio.Future[None]]:
    """An axis that turns by a served stream: what serves it, the stream, and its end."""
    machine = Machine(_Served(axis.bus, x=axis))
    stream = machine.begin(_opened())
    ended = asyncio.ensure_future(stream.wait())
    await asyncio.sleep(0.2)
    machine.set_to("x", (200.0,), 9.0)
    await asyncio.sleep(1.0)
    return machine, stream, ended


def _stopped(machine: Machine) -> asyncio.Future[Any]:
    """Somebody stops it."""
    return asyncio.ensure_future(machine.halt(Halt(frozenset({"x"}), "somebody stops it")))  # type: ignore[arg-type]


@FAMILIES
def test_a_block_that_its_stop_leaves_ends_when_the_motor_stands(make: Make) -> None:
    @virtual
    async def check() -> None:
        async with rig(make) as on:
            with pytest.raises(MoveCancelled):
                async with on.axis.stream(timeout=1.0, acceleration=400) as setpoint:
                    setpoint(200)
                    await asyncio.sleep(1.0)
                    on.axis.stop()
                    setpoint(200)
            assert not on.sim.moving(now())

    check()


@FAMILIES
def test_a_served_stream_that_is_stopped_has_ended_when_the_motor_stands(make: Make) -> None:
    @virtual
    async def check() -> None:
        async with rig(make) as on:
            machine, _, ended = await _served(on.axis)
            confirmed = _stopped(machine)
            with pytest.raises(MoveCancelled):
                await ended
            assert not on.sim.moving(now())
            await confirmed

    check()


@virtual
async def test_a_served_stream_that_is_stopped_and_not_seen_standing_is_told_as_that() -> None:
    sim = SimMks(1)
    async with open_bus(VirtualLine(sim, baudrate=115200)) as bus:
        axis = MksServo(bus, 1)
        await axis.enable()
        machine, _, ended = await _served(axis)
        receive = sim.receive
        sim.receive = lambda frame, at: None  # type: ignore[method-assign]
        confirmed = _stopped(machine)
        with pytest.raises(StopUnconfirmed):
            await ended
        with pytest.raises(StopUnconfirmed):
            await confirmed
        sim.receive = receive  # type: ignore[method-assign]
        await axis.stop()


@virtual
async def test_a_served_stream_that_is_cancelled_is_stopped() -> None:
    sim = SimMks(1)
    async with open_bus(VirtualLine(sim, baudrate=115200)) as bus:
        axis = MksServo(bus, 1)
        await axis.enable()
        _, stream, ended = await _served(axis)
        stream.cancel()
        with pytest.raises(MoveCancelled):
            await asyncio.wait_for(ended, 3.0)
        assert not sim.moving(now())


@virtual
async def test_the_streams_of_a_group_and_of_a_vehicle_end_when_all_stand() -> None:
    sims = SimMks(1), SimTlr(2, machine=TlrMachine(origin=None)), SimZlac(3)

    def stand() -> bool:
        at, (mks, tlr, zlac) = now(), sims
        zlac.advance(at)
        wheels = zlac.left.motor.moving(at) or zlac.right.motor.moving(at)
        return not (mks.moving(at) or tlr.moving(at) or wheels)

    async with open_bus(VirtualLine(*sims, baudrate=115200)) as bus:
        x, y, base = MksServo(bus, 1), TlrStepper(bus, 2), Zlac8015d(bus, 3)
        group = AxisGroup(x=x, y=y)
        await group.enable()
        await base.enable()
        with pytest.raises(MoveCancelled):
            async with group.stream(timeout=1.0, acceleration=300) as setpoint:
                setpoint(x=150, y=150)
                await asyncio.sleep(1.0)
                y.stop()
                setpoint(x=150, y=150)
        assert stand()
        with pytest.raises(MoveCancelled):
            async with DifferentialDrive(base, wheel_radius=0.08, track=0.4).stream(timeout=1.0) as drive:
                drive(0.8, 0.0)
                await asyncio.sleep(1.0)
                base.left.stop()
                drive(0.8, 0.0)
        assert stand()
