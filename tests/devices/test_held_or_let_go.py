"""A shaft that is held in a slow stream, and one that is let go of, are noticed, however slow the drive."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.devices.zlac import registers as r
from rs485bus.errors import BusError, MotionError, NotEnabled
from rs485bus.sim import SimMks, SimTlr, TlrMachine, VirtualLine
from rs485bus.sim.motor import Motor
from tests.devices.stream_rig import now
from tests.devices.zlac.plant import WatchedZlac
from tests.integration.support import virtual


class _Held(Motor):
    """A shaft that something holds."""

    def run(self, rpm: float, ramp: float, now: float) -> None:
        self.halt(now)


def _mks() -> tuple[Any, Callable[[Any], Any], Callable[[Any], None]]:
    return SimMks(1), lambda bus: MksServo(bus, 1), lambda sim: setattr(sim.motion, "motor", _Held())


def _tlr() -> tuple[Any, Callable[[Any], Any], Callable[[Any], None]]:
    sim = SimTlr(1, machine=TlrMachine(origin=None))
    return sim, lambda bus: TlrStepper(bus, 1), lambda sim: setattr(sim.motion, "motor", _Held())


def _zlac(resolution: int) -> tuple[Any, Callable[[Any], Any], Callable[[Any], None]]:
    sim = WatchedZlac(1, watchdog=0)
    sim.set(r.SPEED_RESOLUTION, resolution)
    return (
        sim,
        lambda bus: Zlac8015d(bus, 1, speed_resolution=resolution).left,
        lambda sim: setattr(sim.left, "motor", _Held()),
    )


SLOW = {
    "MKS at 1 rpm": (_mks, 1.0),
    "TL-R at 1 rpm": (_tlr, 1.0),
    "ZLAC at 1 rpm": (lambda: _zlac(1), 1.0),
    "ZLAC at 0.5 rpm": (lambda: _zlac(10), 0.5),
    "ZLAC at 0.1 rpm": (lambda: _zlac(10), 0.1),
}


@pytest.mark.parametrize("which", SLOW)
def test_a_shaft_that_is_held_in_a_slow_stream_is_noticed(which: str) -> None:
    @virtual
    async def check() -> None:
        make, rpm = SLOW[which]
        sim, axis_of, hold = make()
        async with open_bus(VirtualLine(sim, baudrate=115200)) as bus:
            axis = axis_of(bus)
            await axis.enable()
            hold(sim)
            begun = now()
            with pytest.raises(MotionError):
                async with asyncio.timeout(8.0), axis.stream(timeout=0.5) as setpoint:
                    while True:
                        setpoint(rpm)
                        await asyncio.sleep(0.05)
            assert now() - begun < 1.0 + 0.5 / rpm

    check()


async def _move(axis: MksServo) -> None:
    await axis.move_to(50.0, rpm=60)


async def _run(axis: MksServo) -> None:
    await axis.run(60, duration=20.0)


async def _stream(axis: MksServo) -> None:
    async with axis.stream(timeout=0.5) as setpoint:
        while True:
            setpoint(60)
            await asyncio.sleep(0.03)


@pytest.mark.parametrize("verb", [_move, _run, _stream], ids=["move", "run for a time", "stream"])
@pytest.mark.parametrize("phase", [0.0, 0.06, 0.12, 0.18, 0.24])
@pytest.mark.parametrize(("turnaround", "within"), [(0.001, 0.5), (0.04, 0.75)])
def test_a_motor_that_coasts_because_it_was_let_go_of_is_told_in_time(
    verb: Callable[[MksServo], Awaitable[None]], phase: float, turnaround: float, within: float
) -> None:
    @virtual
    async def check() -> None:
        sim = SimMks(1)
        with suppress(BusError):
            async with open_bus(VirtualLine(sim, baudrate=115200, turnaround=turnaround)) as bus:
                axis = MksServo(bus, 1)
                await axis.enable()
                moving = asyncio.ensure_future(verb(axis))
                await asyncio.sleep(1.5 + phase)
                shaft = sim.motion
                rpm = shaft.motor.rpm(now())
                shaft.enable(False, now())
                shaft.motor.run(rpm, float("inf"), now())
                shaft.motor.run(0, 600.0, now())  # it coasts for a tenth of a second
                begun = now()
                with pytest.raises(NotEnabled):
                    await moving
                assert now() - begun <= within

    check()
