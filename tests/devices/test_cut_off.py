"""What an axis goes on with, and nobody waits for any more, is ended by the loss of the port: who commands it next is
told, once."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from rs485bus import AxisGroup, Bus, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.errors import MotionInterrupted, NotEnabled, NotSent
from rs485bus.sim import SimMks, SimTlr, SimZlac, TlrMachine, VirtualLine
from tests.integration.support import virtual


async def loses_the_port(line: VirtualLine, seconds: float = 0.3) -> None:
    line.unplug()
    await asyncio.sleep(seconds)
    line.plug()
    await asyncio.sleep(3.0)


def tlr() -> SimTlr:
    return SimTlr(1, machine=TlrMachine(origin=None))


EACH = pytest.mark.parametrize(
    ("sim", "facade"), [(lambda: SimMks(1), MksServo), (tlr, TlrStepper)], ids=["MKS", "TL-R"]
)


async def running(bus: Bus, facade: Any) -> Any:
    x = facade(bus, 1)
    await x.enable()
    await x.run(60)
    return x


@EACH
@virtual
async def test_a_finished_run_that_the_loss_of_the_port_has_ended_is_told_to_the_next_command_once(
    sim: Any, facade: Any
) -> None:
    async with open_bus(line := VirtualLine(sim())) as bus:
        x = await running(bus, facade)
        await loses_the_port(line)
        where = await x.position()
        with pytest.raises(MotionInterrupted, match="port was lost while it turned"):
            await x.run(30)
        assert await x.position() == where
        await x.run(30)
        assert abs(await x.velocity() - 30) < 2


@EACH
@pytest.mark.parametrize("how", ["move_by", "stream", "group"])
@virtual
async def test_a_move_a_stream_and_a_group_after_a_run_that_was_cut_off_are_told_so_before_anything_turns(
    sim: Any, facade: Any, how: str
) -> None:
    async with open_bus(line := VirtualLine(sim())) as bus:
        x = await running(bus, facade)
        await loses_the_port(line)
        where = await x.position()
        with pytest.raises(MotionInterrupted):
            if how == "move_by":
                await x.move_by(1.0)
            elif how == "group":
                await AxisGroup(x=x).move_by(x=1.0)
            else:
                async with x.stream() as setpoint:
                    setpoint(30.0)
                    await asyncio.sleep(0.5)
        assert await x.position() == where


@EACH
@pytest.mark.parametrize("how", ["enable", "stop", "emergency_stop"])
@virtual
async def test_whoever_enables_or_stops_an_axis_that_was_cut_off_need_not_be_told(
    sim: Any, facade: Any, how: str
) -> None:
    async with open_bus(line := VirtualLine(sim())) as bus:
        x = await running(bus, facade)
        await loses_the_port(line)
        await getattr(x, how)()
        await x.run(30)


@EACH
@virtual
async def test_who_commands_it_while_the_port_is_away_is_told_that_it_turned_and_once_is_enough(
    sim: Any, facade: Any
) -> None:
    async with open_bus(line := VirtualLine(sim())) as bus:
        x = await running(bus, facade)
        line.unplug()
        await asyncio.sleep(0.1)
        with pytest.raises(NotSent, match="It turned, and is stopped as soon as"):
            x.run(30)
        line.plug()
        await asyncio.sleep(3.0)
        await x.run(30)


@EACH
@virtual
async def test_an_axis_that_stood_or_was_told_to_stand_when_the_port_was_lost_takes_commands(
    sim: Any, facade: Any
) -> None:
    async with open_bus(line := VirtualLine(sim())) as bus:
        x = await running(bus, facade)
        await x.stop()
        await loses_the_port(line)
        await x.run(60)
        stopped = x.stop()
        await loses_the_port(line, 0.1)
        await stopped
        await x.run(60)
        await x.run(0)
        await loses_the_port(line)
        await x.run(60)


@pytest.mark.parametrize("how", ["run", "torque"])
@virtual
async def test_a_wheel_that_is_not_enabled_any_more_says_that_the_loss_of_the_port_was_why(how: str) -> None:
    async with open_bus(line := VirtualLine(SimZlac(1, watchdog=0))) as bus:
        base = Zlac8015d(bus, 1)
        await base.enable()
        await (base.left.run(50) if how == "run" else base.left.torque(500))
        await asyncio.sleep(0.5)
        await loses_the_port(line)
        with pytest.raises(NotEnabled, match="since the port was lost while it turned"):
            await base.left.run(30)
        await base.enable()
        await base.left.run(30)
