"""Drives that take their time to answer are seen to stand, beside others that are not there."""

import asyncio
import logging
import random

import pytest

from rs485bus import Bus, BusConfig, MksServo, Unit, Zlac8015d, open_bus
from rs485bus.sim import SimMks, SimUnit, SimZlac, VirtualLine
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


@pytest.mark.parametrize("seed", [203, 215, 237, 249])
@on_virtual_clock
async def test_all_that_take_their_time_are_stopped_at_once_and_none_of_the_guarded_trips(seed: int) -> None:
    """A stop goes before the answer to the one before, which hits it: both are said again, and waited for then."""
    logging.getLogger("rs485bus").disabled = True
    chance = random.Random(seed)
    sims = [SimMks(address) if chance.random() < 0.6 else SimZlac(address, watchdog=0) for address in range(1, 11)]
    for sim in sims:
        sim.turnaround = chance.choice([0.02, 0.02, 0.04] if seed % 2 else [0.02, 0.04])
    async with open_bus(VirtualLine(*sims, baudrate=9600)) as bus:
        drives = [
            MksServo(bus, sim.address) if isinstance(sim, SimMks) else Zlac8015d(bus, sim.address) for sim in sims
        ]
        for drive in drives:
            await drive.enable()
        async with bus.watchdog(*chance.sample(drives, 7), timeout=1.5) as guard:
            for drive in chance.sample(drives, 3):
                await (drive.run(60) if isinstance(drive, MksServo) else drive.run(60, 60))
            polls = [asyncio.create_task(ask(drive)) for drive in drives]
            await asyncio.sleep(chance.random())
            report = await bus.emergency_stop()
            assert [each.address for each in report.devices if not each.standing] == []
            await asyncio.sleep(4.0)
            assert [each.address for each in guard.report() if each.trips] == []
            for poll_of_one in polls:
                poll_of_one.cancel()


async def ask(drive: MksServo | Zlac8015d) -> None:
    while True:
        await drive.status()
        await asyncio.sleep(0.05)


@pytest.mark.parametrize(("turning", "after"), [((5,), 0.25), ((3, 5, 6), 0.1), ((3, 5, 6), 0.4), ((3, 5, 6), 0.55)])
@on_virtual_clock
async def test_three_that_are_slow_do_not_cut_each_others_stops_for_ever(
    turning: tuple[int, ...], after: float
) -> None:
    """The late answer of one falls into the wait for another's, which is waited for all the same."""
    logging.getLogger("rs485bus").disabled = True
    sims = [SimZlac(address, watchdog=0) if address in range(2, 8) else SimMks(address) for address in range(1, 11)]
    for sim in sims:
        sim.turnaround = 0.09 if sim.address in (2, 5, 6) else 0.002
    async with open_bus(VirtualLine(*sims, baudrate=38400)) as bus:
        drives = [
            MksServo(bus, sim.address) if isinstance(sim, SimMks) else Zlac8015d(bus, sim.address) for sim in sims
        ]
        for drive in drives:
            await drive.enable()
        async with bus.watchdog(drives[6], timeout=0.6) as guard:
            for address in turning:
                drive = drives[address - 1]
                await (drive.run(60) if isinstance(drive, MksServo) else drive.run(60, 60))
            await asyncio.sleep(after)
            began = asyncio.get_running_loop().time()
            report = await bus.emergency_stop()
            assert [each.address for each in report.devices if not each.standing] == []
            assert asyncio.get_running_loop().time() - began < 2.0
            assert guard.report()[0].trips == 0
