"""Drives that take their time to answer are seen to stand, beside others that are not there."""

import asyncio
import logging

import pytest

from rs485bus import Bus, BusConfig, MksServo, Unit, open_bus
from rs485bus.sim import SimMks, SimUnit, VirtualLine
from tests.devices.mks.bench import on_virtual_clock


async def running(bus: Bus, sims: list[SimMks]) -> list[MksServo]:
    axes = [MksServo(bus, sim.address) for sim in sims]
    for axis in axes:
        await axis.enable()
        await axis.run(120, acceleration=2000)
    return axes


async def stands(bus: Bus, address: int, within: float) -> bool:
    loop = asyncio.get_running_loop()
    ends = loop.time() + within
    while bus.owner.units[address].halt is not None and loop.time() < ends:  # noqa: ASYNC110
        await asyncio.sleep(0.02)
    return bus.owner.units[address].halt is None


def bus_of(sims: list[SimMks], takes: float, *others: SimUnit) -> VirtualLine:
    return VirtualLine(*sims, *others, baudrate=9600, turnaround=takes)


async def poll(unit: Unit) -> None:
    while True:
        await unit.read_holding_registers(0, 40)


CONFIG = BusConfig(supervision=5.0, close_timeout=1.0)


@pytest.mark.parametrize("takes", [0.02, 0.06, 0.075, 0.09])
@pytest.mark.parametrize("live", [7, 1])
@on_virtual_clock
async def test_all_that_answer_are_seen_to_stand_after_an_emergency_stop(live: int, takes: float) -> None:
    """At 9600 baud, beside one that has lost its power. A round of all takes longer than 100 ms, by far."""
    logging.getLogger("rs485bus").disabled = True
    sims = [SimMks(address) for address in range(1, live + 2)]
    with pytest.raises(ExceptionGroup):  # the one that is dead has not been seen to stand
        async with open_bus(bus_of(sims, takes), config=CONFIG) as bus:
            await running(bus, sims)
            sims[-1].switch_off(asyncio.get_running_loop().time())
            began = asyncio.get_running_loop().time()
            report = await bus.emergency_stop()
            assert {each.address for each in report.devices if each.standing} == set(range(1, live + 1))
            assert asyncio.get_running_loop().time() - began < 6.0


@pytest.mark.parametrize("polled", [False, True])
@pytest.mark.parametrize("takes", [0.06, 0.09])
@on_virtual_clock
async def test_one_that_was_not_seen_to_stand_is_as_soon_as_it_answers_again(takes: float, polled: bool) -> None:
    """Also where what others are asked falls into answers that are not waited for."""
    logging.getLogger("rs485bus").disabled = True
    sims = [SimMks(address) for address in (1, 2, 3)]
    unit = SimUnit(9, dict.fromkeys(range(100), 7))
    unit.turnaround = 0.002
    gone = False
    hears = sims[0].receive
    sims[0].receive = lambda frame, now: None if gone else hears(frame, now)  # type: ignore[method-assign]
    with pytest.raises(ExceptionGroup):
        async with open_bus(bus_of(sims, takes, unit), config=CONFIG) as bus:
            await running(bus, sims)
            gone = True
            sims[2].switch_off(asyncio.get_running_loop().time())
            report = await bus.emergency_stop()
            assert [each.standing for each in report.devices] == [False, True, False]
            poller = asyncio.create_task(poll(bus.unit(9)) if polled else asyncio.sleep(0))
            await asyncio.sleep(2.0)
            assert sims[0].moving(asyncio.get_running_loop().time())
            gone = False
            assert await stands(bus, 1, within=2.0)
            poller.cancel()
            assert not sims[0].moving(asyncio.get_running_loop().time())
