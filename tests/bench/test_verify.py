"""What the manuals leave open is found on virtual drives whose options are drawn at random."""

import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.bench.verify import mks, tlr, zlac
from rs485bus.bench.verify.question import OpenDrive, Result, ask_all
from rs485bus.devices.mks import Status
from rs485bus.devices.zlac import ShaftState, registers
from rs485bus.plant.options import typed_options
from rs485bus.sim import SimDevice, SimMks, SimTlr, SimZlac, VirtualLine
from tests.integration.support import virtual


def found(results: list[Result]) -> dict[str, Any]:
    """All that was found, in one table."""
    assert [result.error for result in results if result.answer is None] == []
    table: dict[str, Any] = {}
    for result in results:
        assert result.answer is not None
        table |= {**result.answer.measured, **result.answer.options}
    return table


def on(sim: SimDevice, facade: Any) -> OpenDrive:
    """Opens a virtual drive."""

    @asynccontextmanager
    async def open_drive(options: dict[str, Any], bare: bool) -> AsyncIterator[Any]:
        async with open_bus(VirtualLine(sim)) as bus:
            yield bus.unit(sim.address) if bare else facade(bus, sim.address, **typed_options(facade, options))

    return open_drive


async def check_tlr(draw: random.Random) -> None:
    truncates = draw.choice([None, None, 1, 2, 4, 5])
    options: dict[str, Any] = {
        "trigger": draw.choice(["edge", "write"]),
        "truncates": truncates,
        "admits_truncation": draw.random() < 0.5,
        "denies": draw.random() < 0.5,
        "keeps_target": draw.random() < 0.5,
        "live_jog": draw.random() < 0.5,
        "enabled_bit": draw.choice([None, True, False]),
        "ramp_rpm": draw.choice([None, 1000.0, 1500.0, 3000.0]),
        "subdivision": draw.choice([400, 1600, 4000, 51200]),
    }
    answers = found(await ask_all(on(SimTlr(5, **options), TlrStepper), tlr.QUESTIONS))
    assert answers["trigger"] == options["trigger"]
    assert answers["clear_trigger"] is (options["trigger"] == "edge")
    assert answers["block_writes"] is (truncates is None)
    assert answers["kept"] == (6 if truncates is None else truncates)
    assert answers["keeps_target"] is options["keeps_target"]
    assert answers["live_jog"] is options["live_jog"]
    assert answers["enabled_bit"] is (options["enabled_bit"] is None)
    assert answers["ramp_rpm"] == options["ramp_rpm"]


async def check_zlac(draw: random.Random) -> None:
    options: dict[str, Any] = {
        "status_word_left": draw.choice(["low", "high"]),
        "ramp_rpm": draw.choice([None, 1000.0, 1500.0, 3000.0]),
        "mode_change_releases": draw.random() < 0.5,
        "rpm_in_position_mode": draw.random() < 0.5,
        "trip_state": draw.choice([ShaftState.EMERGENCY_STOP, ShaftState.LOCKED, ShaftState.RELEASED]),
        "lines": draw.choice([1024, 2500, 4096]),
        "watchdog": draw.choice([0, 1000]),
    }
    sim = SimZlac(5, **options)
    answers = found(await ask_all(on(sim, Zlac8015d), zlac.QUESTIONS))
    assert sim.value(registers.WATCHDOG) == options["watchdog"]
    assert answers["status_word_left"] == options["status_word_left"]
    assert answers["ramp_rpm"] == options["ramp_rpm"]
    assert answers["smooth_stop"] is (not options["mode_change_releases"])
    assert answers["rpm_in_position_mode"] is options["rpm_in_position_mode"]
    assert (answers["trips"], answers["reads_feed"]) == (True, True)
    assert answers["trip_state"] == options["trip_state"].name


async def check_mks(draw: random.Random) -> None:
    feeds = {what for what in ("others", "broadcasts") if draw.random() < 0.5}
    options: dict[str, Any] = {
        "microsteps": draw.choice([1, 2, 8, 16, 32, 64, 77, 128, 255]),
        "stuck_status": draw.choice([None, Status.SLOWING_DOWN, Status.FULL_SPEED]),
        "trip_latches": draw.random() < 0.5,
        "fed_by": frozenset({"reads", "writes"} | feeds),
        "enabled_at_power_on": draw.random() < 0.5,
    }
    answers = found(await ask_all(on(SimMks(5, **options), MksServo), mks.QUESTIONS))
    assert answers["microsteps"] == options["microsteps"]
    assert answers["stuck_status"] == (options["stuck_status"] and options["stuck_status"].name)
    assert answers["positive"] == "CCW"
    assert answers["trips"] is True
    assert answers["latches"] is options["trip_latches"]
    names = {"reads": "reads", "others": "frames to others", "broadcasts": "broadcasts"}
    assert answers["fed_by"] == [names[what] for what in names if what in options["fed_by"]]


CHECKS = {"mks": check_mks, "tlr": check_tlr, "zlac": check_zlac}


FOUND = [("mks", 3), ("mks", 22), ("zlac", 21)]
"""A status that sticks at full speed, which the bus takes for a shaft that is held; and two microsteps, at which a raw
motion is faster than any that the facade reckons with; and a wheel that the bus stops as soon as it stands."""


@pytest.mark.parametrize(("family", "seed"), [*((family, seed) for seed in range(2) for family in CHECKS), *FOUND])
@virtual
async def test_the_options_of_a_drive_drawn_at_random_are_found(seed: int, family: str) -> None:
    await CHECKS[family](random.Random(seed))
