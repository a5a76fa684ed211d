"""What a watchdog block leaves to everything else: it is usable, or it is refused; and it is reckoned anew."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from rs485bus import AxisGroup, BusConfig, MksServo, Zlac8015d, open_bus
from rs485bus.devices.mks.homing import SwitchHoming
from rs485bus.devices.mks.settings import VFOC_GAINS
from rs485bus.devices.zlac import registers as zlac
from rs485bus.devices.zlac.values import Brake, Side
from rs485bus.errors import BusError, NoReply, NotSent, RearmRequired, WatchdogInfeasible
from rs485bus.sim import Machine, SimUnit, VirtualLine
from tests.integration.guarded import FaultyMks, FaultyZlac, mks_bus, within
from tests.integration.support import virtual

Use = Callable[[Any], Awaitable[Any]]
USES_OF_AN_MKS: list[Use] = [
    lambda x: x.enable(),
    lambda x: x.position(),
    lambda x: x.velocity(),
    lambda x: x.status(),
    lambda x: x.idle(),
    lambda x: x.motor_status(),
    lambda x: x.enabled(),
    lambda x: x.homed(),
    lambda x: x.stalled(),
    lambda x: x.inputs(),
    lambda x: x.counts(),
    lambda x: x.encoder(),
    lambda x: x.pulses(),
    lambda x: x.angle_error(),
    lambda x: x.version(),
    lambda x: x.move_to(0.2),
    lambda x: x.move_by(0.1),
    lambda x: x.move_by_pulses(320),
    lambda x: x.move_by_counts(1000),
    lambda x: x.move_to_pulses(640),
    lambda x: x.run(60, duration=0.2),
    lambda x: x.stop(),
    lambda x: x.set_zero(),
    lambda x: x.set_current(1000),
    lambda x: x.set_microsteps(16),
    lambda x: x.set_vfoc_gains(VFOC_GAINS),
    lambda x: x.set_homing(SwitchHoming()),
    lambda x: x.home(),
    lambda x: x.release_stall(),
    lambda x: x.disable(),
]
USES_OF_A_ZLAC: list[Use] = [
    lambda base: base.enable(),
    lambda base: base.set_up(),
    lambda base: base.snapshot(),
    lambda base: base.status(),
    lambda base: base.parameters(Side.LEFT),
    lambda base: base.parameter(zlac.RATED_CURRENT.left),
    lambda base: base.move_to(0.1, 0.2),
    lambda base: base.left.move_by(0.1),
    lambda base: base.run(20, 20),
    lambda base: base.left.velocity(),
    lambda base: base.stop(),
    lambda base: base.set_brakes(Brake.OPEN, Brake.OPEN),
    lambda base: base.clear_faults(),
    lambda base: base.set_zero(),
    lambda base: base.emergency_stop(),
    lambda base: base.enable(),
]


def axis_of(bus: Any, sim: Any) -> Any:
    return MksServo(bus, sim.address) if isinstance(sim, FaultyMks) else Zlac8015d(bus, sim.address)


def uses(axis: Any) -> list[Use]:
    return USES_OF_AN_MKS if isinstance(axis, MksServo) else USES_OF_A_ZLAC


def sims_of(families: str) -> list[Any]:
    return [
        FaultyMks(at, machine=Machine(home_switch=-0.5)) if family == "m" else FaultyZlac(at, watchdog=0)
        for at, family in enumerate(families, 1)
    ]


async def use_in(families: str, baudrate: int, timeout: float, config: BusConfig) -> bool:
    """Guard drives for so long and use the first of each family as can be. False if the block is refused."""
    sims = sims_of(families)
    async with open_bus(VirtualLine(*sims, baudrate=baudrate), config=config) as bus:
        axes = [axis_of(bus, sim) for sim in sims]
        for axis in axes:
            await axis.enable()
        try:
            async with bus.watchdog(*axes, timeout=timeout):
                for axis in {type(axis): axis for axis in reversed(axes)}.values():
                    for use in uses(axis):
                        await within(60.0, use(axis))
        except WatchdogInfeasible:
            return False
        assert all(sim.trips == [] for sim in sims)
    return True


# Admitted means usable


@pytest.mark.parametrize(
    ("families", "baudrate", "timeouts", "config"),
    [
        ("m", 9600, (0.37, 0.38, 0.39, 0.40), BusConfig()),
        ("mmm", 115200, (0.50,), BusConfig()),
        ("m" * 12, 9600, (1.02, 1.03, 1.04, 1.05), BusConfig()),
        ("m", 115200, (0.2,), BusConfig(turnaround=0)),
        ("m", 115200, (0.33,), BusConfig()),
        ("mm", 115200, (0.5,), BusConfig()),
        ("z", 115200, (0.5,), BusConfig()),
    ],
)
def test_a_block_that_is_admitted_refuses_nothing_of_its_own_axes(
    families: str, baudrate: int, timeouts: tuple[float, ...], config: BusConfig
) -> None:
    @virtual
    async def go() -> None:
        for timeout in timeouts:
            await use_in(families, baudrate, timeout, config)

    go()


@pytest.mark.parametrize(("families", "baudrate"), [("m", 9600), ("mz", 38400), ("mzm", 115200), ("mz" * 5, 115200)])
@virtual
async def test_in_the_tightest_admitted_block_every_verb_and_question_works(families: str, baudrate: int) -> None:
    low, high = 100, 3000
    while low < high:
        middle = (low + high) // 2
        sims = sims_of(families)
        async with open_bus(VirtualLine(*sims, baudrate=baudrate)) as bus:
            axes = [axis_of(bus, sim) for sim in sims]
            try:
                async with bus.watchdog(*axes, timeout=middle / 1000):
                    high = middle
            except WatchdogInfeasible:
                low = middle + 1
    assert 400 < high < 3000
    assert await use_in(families, baudrate, high / 1000, BusConfig())
    assert not await use_in(families, baudrate, (high - 1) / 1000, BusConfig())


@virtual
async def test_no_request_of_a_guarded_axis_is_longer_than_its_family_says() -> None:
    sims = sims_of("mz")
    async with open_bus(VirtualLine(*sims)) as bus:
        axes = [axis_of(bus, sim) for sim in sims]
        longest = {1: 0, 2: 0}

        def note(record: Any) -> None:
            longest[record.address] = max(longest[record.address], len(record.request) + len(record.reply))

        bus.subscribe(note)
        for axis in axes:
            for use in uses(axis):
                await use(axis)
        assert longest == {axis.attached.address: axis.attached.longest for axis in axes}


@virtual
async def test_guarded_axes_start_as_a_group_in_a_block_of_half_a_second() -> None:
    async with mks_bus(2) as (bus, sims, (x, y)), bus.watchdog(x, y, timeout=0.5):
        await x.enable()
        await y.enable()
        await AxisGroup(x=x, y=y).move_to(x=1.0, y=2.0)
        assert [sim.trips for sim in sims] == [[], []]


# Reckoned anew


async def read_slowly(bus: Any) -> list[int]:
    """A read that may take two seconds."""
    return list(await bus.unit(99).read_holding_registers(0, 1, reply_timeout=2.0))


@virtual
async def test_after_a_short_inner_block_long_reads_are_answered_again() -> None:
    sims = [FaultyMks(1), FaultyMks(2)]
    async with open_bus(VirtualLine(*sims, SimUnit(99, {0: 7}))) as bus:
        x, y = (MksServo(bus, sim.address) for sim in sims)
        async with x.watchdog(10.0):
            assert await read_slowly(bus) == [7]
            async with y.watchdog(1.0):
                with pytest.raises(NotSent, match="so long that an armed watchdog could trip"):
                    await read_slowly(bus)
            assert await read_slowly(bus) == [7]
        assert [sim.trips for sim in sims] == [[], []]


@virtual
async def test_after_a_longer_block_what_is_dangerous_for_the_time_that_a_zlac_had_is_refused() -> None:
    sim = FaultyZlac(1, watchdog=1000)
    async with open_bus(VirtualLine(sim, SimUnit(99, {0: 7}))) as bus:
        base = Zlac8015d(bus, 1)
        await base.enable()
        for _ in range(2):
            with pytest.raises(NotSent, match="so long that an armed watchdog could trip"):
                await read_slowly(bus)
            async with base.watchdog(10.0):
                assert await read_slowly(bus) == [7]
        assert sim.watchdog_ms == 1000
        await asyncio.sleep(5.0)
        assert sim.longest_unheard < 0.6 or sim.trips == []


@virtual
async def test_a_time_that_is_written_shorter_leaves_less_room_at_once() -> None:
    sim = FaultyZlac(1, watchdog=10_000)
    async with open_bus(VirtualLine(sim, SimUnit(99, {0: 7}))) as bus:
        base = Zlac8015d(bus, 1)
        await base.enable()
        assert await read_slowly(bus) == [7]
        await bus.unit(1).write_register(0x2000, 1000)
        with pytest.raises(NotSent):
            await read_slowly(bus)
        await bus.unit(1).write_register(0x2000, 10_000)
        assert await read_slowly(bus) == [7]


# Drives that become slow inside of a block


@pytest.mark.parametrize(("count", "slow", "timeout"), [(28, 0.02, 1.0), (16, 0.03, 0.9), (5, 0.09, 0.6)])
@virtual
async def test_drives_that_become_slow_inside_of_a_block_keep_nothing_from_ending(
    count: int, slow: float, timeout: float, caplog: pytest.LogCaptureFixture
) -> None:
    sims = [FaultyMks(address) for address in range(1, count + 1)]
    async with open_bus(VirtualLine(*sims, SimUnit(99, {0: 7}))) as bus:
        axes = [MksServo(bus, sim.address) for sim in sims]
        with caplog.at_level(logging.WARNING, "rs485bus"):
            async with bus.watchdog(*axes, timeout=timeout) as guard:
                await axes[0].enable()
                for sim in sims:
                    sim.slow = slow
                await asyncio.sleep(timeout)
                for _ in range(5):
                    await within(2 * timeout + 1.0, bus.unit(99).read_holding_registers(0, 1))
                try:
                    await within(15.0, axes[0].run(60).wait())
                except BusError as error:
                    assert isinstance(error, RearmRequired | NoReply)  # noqa: PT017 - given up, or too slow
                await asyncio.sleep(3.0)
                begun = bus.now()
                reports = guard.report()
            assert bus.now() - begun < 6.0
        assert "the watchdogs can hardly be fed any more" in caplog.text
        tripped = [report.address for report in reports if report.trips]
        # Who was not given up never tripped: none was unheard for its time, by the drive's own reckoning.
        for sim in sims:
            if sim.address not in tripped:
                assert sim.trips == []
        assert not any(sim.moving(bus.now()) for sim in sims)
        assert all(sim.watchdog_ms == 0 for sim in sims if sim.address not in tripped)


@virtual
async def test_a_slow_drive_that_was_given_up_is_refused_by_enable_with_the_numbers_until_it_is_quick_again() -> None:
    async with mks_bus(6) as (bus, sims, axes), bus.watchdog(*axes, timeout=0.6) as guard:
        for sim in sims:
            sim.slow = 0.095
        await asyncio.sleep(3.0)
        given_up = [report.address for report in guard.report() if report.trips]
        assert 1 <= len(given_up) <= 4
        axis = axes[given_up[0] - 1]
        await axis.emergency_stop()
        with pytest.raises(WatchdogInfeasible):
            await axis.enable()
        with pytest.raises(RearmRequired, match="cannot be fed in time any more"):
            await axis.run(60)  # what was refused leaves it as locked as it was
        for sim in sims:
            sim.slow = None
        await asyncio.sleep(3.0)
        await axis.enable()
        await axis.run(60)
        await asyncio.sleep(2.0)
        assert sims[given_up[0] - 1].moving(bus.now())
