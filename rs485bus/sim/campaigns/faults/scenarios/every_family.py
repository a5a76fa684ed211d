"""What applications do with any axis, whatever its family.

Each shaft stands above its origin switch; a ZLAC's axis is its left wheel.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from rs485bus.sim.campaigns.faults.recorder import Recorded
from rs485bus.sim.campaigns.faults.scenario import Play, scenario
from rs485bus.sim.campaigns.faults.world import World

FAMILIES = ("mks", "zlac", "tlr")


def for_each_family(*families: str, **options: Any) -> Callable[[Play], Play]:
    """Make a function a scenario of each family, or of those named, with one drive."""

    def add(play: Play) -> Play:
        for family in families or FAMILIES:
            scenario(family, **options)(play)
        return play

    return add


def first(app: World, **options: Any) -> Recorded:
    """The axis of the drive at address 1, or its left wheel."""
    drive = app.axis(1, **options)
    wheel: Recorded = drive.left if "left" in drive.members else drive
    return wheel


@for_each_family(short=True)
async def move_there_and_back(app: World) -> None:
    """Enable, go to a position, a distance back, ask where it is."""
    async with app.bus():
        x = first(app)
        await x.enable()
        await x.move_to(0.6)
        await x.move_by(-0.4)
        await x.position()


@for_each_family(short=True)
async def move_twice(app: World) -> None:
    """Go to a position and back, both queued at once."""
    async with app.bus():
        x = first(app)
        x.enable()
        move, back = x.move_to(0.5), x.move_to(0.0)
        await move
        await back


@for_each_family()
async def zero_and_by(app: World) -> None:
    """Make the place where it stands zero, between relative moves."""
    async with app.bus():
        x = first(app)
        await x.enable()
        await x.move_by(0.4)
        await x.set_zero()
        await x.move_by(0.3)
        await x.move_by(0.3)
        await x.position()
        await x.disable()


@for_each_family()
async def run_and_stop(app: World) -> None:
    """Turn at a speed, at another one, and stop."""
    async with app.bus():
        x = first(app)
        await x.enable()
        await x.run(120.0)
        await app.sleep(0.2)
        await x.run(180.0)
        await x.velocity()
        await x.stop()
        await x.position()


@for_each_family()
async def run_for_a_time(app: World) -> None:
    """Turn for a time, the other way round."""
    async with app.bus():
        x = first(app)
        await x.enable()
        await x.run(-120.0, duration=0.4)
        await x.position()


@for_each_family()
async def run_to_a_stand(app: World) -> None:
    """Turn, and slow down to a stand by a run at 0."""
    async with app.bus():
        x = first(app)
        await x.enable()
        await x.run(120.0)
        await x.run(0.0)
        await x.move_by(0.2)


@for_each_family()
async def stop_in_the_middle(app: World) -> None:
    """Stop a move under way, look, and go on."""
    async with app.bus():
        x = first(app)
        await x.enable()
        x.move_to(5.0)
        await app.sleep(0.2)
        await x.stop()
        await x.position()
        await x.enable()
        await x.move_to(0.3)


@for_each_family()
async def cancel_in_the_middle(app: World) -> None:
    """Cancel a move under way, with another one queued behind it."""
    async with app.bus():
        x = first(app)
        await x.enable()
        move = x.move_to(5.0)
        x.move_to(0.0)
        await app.sleep(0.2)
        move.cancel()
        await x.stop()
        await x.enable()
        await x.move_by(0.2)


@for_each_family()
async def emergency_and_back(app: World) -> None:
    """An emergency stop of the bus during a move; cleared; and on."""
    async with app.bus() as bus:
        x = first(app)
        await x.enable()
        x.move_to(5.0)
        await app.sleep(0.2)
        await bus.emergency_stop()
        bus.clear_emergency_stop()
        await x.enable()
        await x.move_to(0.3)


@for_each_family()
async def left_while_moving(app: World) -> None:
    """The block is left in the line after a move that nobody awaits: it is waited for."""
    async with app.bus():
        x = first(app)
        x.enable()
        x.move_to(0.7)


@for_each_family()
async def left_by_an_error(app: World) -> None:
    """The block is left by an exception during a run: everything stops."""
    async with app.bus():
        x = first(app)
        await x.enable()
        await x.run(150.0)
        await app.sleep(0.1)
        raise ValueError("the application makes a mistake")


@for_each_family()
async def stopped_and_left(app: World) -> None:
    """A stop that nobody awaits, and the block is left in the next line."""
    async with app.bus():
        x = first(app)
        await x.enable()
        await x.run(150.0)
        x.stop()


@for_each_family()
async def left_running(app: World) -> None:
    """The block is left with the motor running, as the application wants."""
    async with app.bus(leave_running=True):
        x = first(app)
        await x.enable()
        await x.run(150.0)


@for_each_family()
async def left_by_a_timeout(app: World) -> None:
    """The application takes too long, and its time is over while the motor turns: the block is left by that."""
    try:
        async with asyncio.timeout(1.0), app.bus():
            x = first(app)
            await x.enable()
            await x.move_to(40.0)
    except TimeoutError:
        await app.sleep(0.1)


@for_each_family()
async def move_left_by_an_error(app: World) -> None:
    """The block of a move is left by an exception: it stops, and the next move goes on."""
    async with app.bus():
        x = first(app)
        await x.enable()
        with contextlib.suppress(ValueError):
            async with x.move_to(5.0):
                await app.sleep(0.1)
                raise ValueError("the application makes a mistake")
        await x.stop()
        await x.move_by(0.2)


@for_each_family()
async def within_limits(app: World) -> None:
    """Moves between limits; what lies outside is refused, and nothing moves for it."""
    async with app.bus():
        x = first(app, limits=(-0.4, 0.8))
        await x.enable()
        await x.move_to(0.8)
        try:
            await x.move_to(1.2)
        except ValueError:
            await x.move_to(-0.4)


@for_each_family("mks", "tlr")
async def stream_of_speeds(app: World) -> None:
    """Set-points, twenty a second, one way and the other; the block is left while it turns."""
    async with app.bus():
        x = first(app)
        await x.enable()
        async with x.stream(timeout=0.25) as setpoint:
            for rpm in (60.0, 120.0, 120.0, 30.0, -60.0, -90.0):
                setpoint(rpm)
                await app.sleep(0.05)
        await x.move_by(0.2)


@for_each_family("mks", "tlr")
async def stream_runs_dry(app: World) -> None:
    """A stream whose set-points end for a while: the motor stops by itself, and goes on with the next one."""
    async with app.bus():
        x = first(app)
        await x.enable()
        async with x.stream(timeout=0.2) as setpoint:
            setpoint(100.0)
            await app.sleep(0.8)
            setpoint(-100.0)
            await app.sleep(0.1)


@for_each_family()
async def polled_while_moving(app: World) -> None:
    """An application that asks everything 20 times a second while it moves."""
    async with app.bus():
        x = first(app)
        await x.enable()
        app.poll()
        await x.move_to(0.8)
        await x.move_by(-0.8)
