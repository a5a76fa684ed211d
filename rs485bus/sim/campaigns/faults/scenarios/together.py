"""What applications do with several axes: callers side by side, groups, several families on one bus and on two."""

from __future__ import annotations

from rs485bus.sim.campaigns.faults.recorder import Recorded
from rs485bus.sim.campaigns.faults.scenario import scenario
from rs485bus.sim.campaigns.faults.world import World

_TWO = (("mks", 1), ("mks", 2))
_MIXED = (("mks", 1), ("zlac", 2), ("tlr", 3))


async def _go(axis: Recorded) -> None:
    await axis.enable()
    await axis.move_to(0.6)
    await axis.move_by(-0.3)


@scenario("together", _TWO)
async def two_callers(app: World) -> None:
    """Two axes, each moved by its own task."""
    async with app.bus():
        x, y = app.axis(1), app.axis(2)
        await app.both(_go(x), _go(y))


@scenario("together", _MIXED)
async def three_families(app: World) -> None:
    """Three families on one pair, each moved by its own task."""
    async with app.bus():
        x, base, z = app.axis(1), app.axis(2), app.axis(3)
        await app.both(_go(x), _go(base.left), _go(z))


@scenario("together", _TWO)
async def group_arrives(app: World) -> None:
    """Two axes that arrive together, and come back."""
    async with app.bus():
        group = app.group(x=app.axis(1), y=app.axis(2))
        await group.enable()
        await group.move_to(x=0.5, y=-0.3)
        await group.move_by(x=-0.5, y=0.3)
        await group.positions()


@scenario("together", _MIXED)
async def mixed_group(app: World) -> None:
    """A servo, a wheel and a stepper that arrive together."""
    async with app.bus():
        group = app.group(x=app.axis(1), y=app.axis(2).left, z=app.axis(3))
        await group.enable()
        await group.move_to(x=0.5, y=0.4, z=-0.3)
        await group.stop()


@scenario("together", (("mks", 1),), (("tlr", 2),))
async def group_on_two_buses(app: World) -> None:
    """Two axes on two pairs that arrive together."""
    async with app.bus(0), app.bus(1):
        group = app.group(x=app.axis(1), y=app.axis(2, bus=1))
        await group.enable()
        await group.move_to(x=0.5, y=-0.3)


@scenario("together", _MIXED)
async def guarded_group_and_emergency(app: World) -> None:
    """Guarded axes of two families, an emergency stop during a group's move, and the move again."""
    async with app.bus() as bus:
        x, base = app.axis(1), app.axis(2)
        group = app.group(x=x, y=base.left)
        await group.enable()
        async with bus.watchdog(x, base, timeout=0.6):
            group.move_to(x=4.0, y=4.0)
            await app.sleep(0.2)
            await bus.emergency_stop()
            bus.clear_emergency_stop()
            await group.enable()
            await group.move_to(x=0.3, y=0.3)


@scenario("together", (("mks", 1), ("tlr", 2)))
async def group_streams(app: World) -> None:
    """Two axes of two families are told set-points together; the block is left while they turn."""
    async with app.bus():
        group = app.group(x=app.axis(1), y=app.axis(2))
        await group.enable()
        async with group.stream(timeout=0.25) as setpoint:
            for rpm in (60.0, 90.0, -60.0):
                setpoint(x=rpm, y=-rpm)
                await app.sleep(0.08)
        await group.move_to(x=0.2, y=0.2)


@scenario("together", (("mks", 1),), (("zlac", 2),))
async def emergency_on_one_of_two_buses(app: World) -> None:
    """A group on two pairs; an emergency stop of one of them stops the axis on the other, too. And the move again."""
    async with app.bus(0) as bus, app.bus(1):
        group = app.group(x=app.axis(1), y=app.axis(2, bus=1).left)
        await group.enable()
        group.move_to(x=4.0, y=4.0)
        await app.sleep(0.2)
        await bus.emergency_stop()
        bus.clear_emergency_stop()
        await group.stop()
        await group.enable()
        await group.move_to(x=0.3, y=0.3)


@scenario("together", (("mks", 1), ("mks", 2)), (("tlr", 3),))
async def guarded_on_two_buses(app: World) -> None:
    """A guarded group with a lease on one pair moves with an axis on another; the lease lapses during a run."""
    async with app.bus(0) as bus, app.bus(1):
        x, y, z = app.axis(1), app.axis(2), app.axis(3, bus=1)
        group = app.group(x=x, y=y, z=z)
        await group.enable()
        async with bus.watchdog(x, y, timeout=0.6, lease=1.5) as watchdog:
            await group.move_to(x=0.5, y=-0.4, z=0.3)
            watchdog.renew()
            await x.run(120.0)
            await app.sleep(2.0)
