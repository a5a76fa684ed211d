"""Jogging: what keys mean at each moment, and that a motor stops when nobody tells it to turn any more."""

import asyncio
from typing import Any

import pytest

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.bench.jog import AGAIN, FIRST, Jog, keys_in
from rs485bus.errors import BusError
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine
from tests.integration.support import virtual


def jog() -> Jog:
    return Jog(rpm=40, fastest=100)


def test_a_held_key_turns_and_one_let_go_stops() -> None:
    keys = jog()
    assert keys.speed(0.0) == 0
    keys.key("right", 1.0)
    assert keys.speed(1.0 + FIRST - 0.01) == 40
    keys.key("right", 1.5)  # it repeats
    keys.key("right", 1.53)
    assert keys.speed(1.53 + AGAIN - 0.01) == 40
    assert keys.speed(1.53 + AGAIN) == 0
    assert keys.speed(1.54) == 0  # for good


def test_a_key_that_is_hit_once_turns_for_the_first_pause_alone() -> None:
    keys = jog()
    keys.key("a", 1.0)
    assert keys.speed(1.1) == -40
    assert keys.speed(1.0 + FIRST) == 0


@pytest.mark.parametrize("key", [" ", "x", "\n", "e", "q", "esc"])
def test_any_other_key_stops(key: str) -> None:
    keys = jog()
    keys.key("d", 1.0)
    keys.key(key, 1.01)
    assert keys.speed(1.02) == 0


def test_up_and_down_change_the_speed_within_what_the_axis_can_do() -> None:
    keys = jog()
    for _ in range(20):
        keys.key("up", 0.0)
    assert keys.rpm == 100
    for _ in range(100):
        keys.key("down", 0.0)
    assert keys.rpm == 1


def test_it_says_why_an_axis_does_not_turn() -> None:
    def state(asked: float, actual: float, position: float) -> str:
        return jog().state(asked, actual, position, (0.0, 120.0), "mm")

    assert state(30, 29, 60) == "turns"
    assert state(0, 29, 60) == "stops"
    assert state(0, 0, 60) == "stands"
    assert state(30, 0, 60) == "begins to turn"
    assert state(-30, 0, 0.1) == state(-30, 0, -3) == "at its limit, 0 mm: is it homed?"
    assert state(30, 0, 119.9) == "at its limit, 120 mm: is it homed?"
    assert state(30, 0, 0.1) == "begins to turn"
    assert jog().state(30, 0, 0.1, None, "mm") == "begins to turn"


def test_what_a_terminal_sends_is_read_as_keys() -> None:
    assert keys_in("\x1b[C\x1b[C\x1bODa \x1b") == ["right", "right", "left", "a", " ", "esc"]


def axes(bus: Any) -> dict[str, Any]:
    return {"mks": MksServo(bus, 1), "tlr": TlrStepper(bus, 2), "zlac": Zlac8015d(bus, 3).left}


@pytest.mark.parametrize("family", ["mks", "tlr", "zlac"])
@virtual
async def test_set_points_turn_an_axis_until_nobody_tells_them_any_more(family: str) -> None:
    async with open_bus(VirtualLine(SimMks(1), SimTlr(2), SimZlac(3))) as bus:
        axis = axes(bus)[family]
        await axis.enable()
        async with axis.stream(timeout=0.25) as setpoint:
            for _ in range(20):
                setpoint(60)
                await asyncio.sleep(0.05)
            assert await axis.velocity() == pytest.approx(60, abs=3)
            await asyncio.sleep(2.0)
            assert await axis.velocity() == 0
            for _ in range(30):
                setpoint(-60)
                await asyncio.sleep(0.05)
            assert await axis.velocity() == pytest.approx(-60, abs=3)
        assert await axis.velocity() == 0


@virtual
async def test_what_fails_meanwhile_is_told() -> None:
    line = VirtualLine(SimMks(1))
    async with open_bus(line) as bus:
        axis = MksServo(bus, 1)
        await axis.enable()
        with pytest.raises(BusError):
            async with axis.stream(timeout=0.25) as setpoint:
                for _ in range(200):
                    setpoint(60)
                    await asyncio.sleep(0.05)
                    bus.emergency_stop()
