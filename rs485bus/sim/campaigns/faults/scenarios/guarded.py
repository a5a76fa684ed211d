"""What applications do with axes that have a watchdog, in a block that arms it."""

from __future__ import annotations

from rs485bus.sim.campaigns.faults.scenario import Play, scenario
from rs485bus.sim.campaigns.faults.scenarios.every_family import first
from rs485bus.sim.campaigns.faults.world import World


def _for_each_guarded(play: Play) -> Play:
    for family in ("mks", "zlac"):
        scenario(family)(play)
    return play


@_for_each_guarded
async def guarded_moves(app: World) -> None:
    """Moves in a watchdog block with a lease that is renewed."""
    async with app.bus() as bus:
        x = first(app)
        await x.enable()
        async with bus.watchdog(x, timeout=0.5, lease=3.0) as watchdog:
            await x.move_to(0.5)
            watchdog.renew()
            await x.move_to(-0.2)


@_for_each_guarded
async def guarded_run_left(app: World) -> None:
    """A watchdog block that is left while the motor turns: it is stopped, and the watchdog turned off."""
    async with app.bus() as bus:
        x = first(app)
        await x.enable()
        async with bus.watchdog(x, timeout=0.5):
            await x.run(120.0)
            await app.sleep(0.7)
        await x.move_by(0.2)


@_for_each_guarded
async def guarded_lease_lapses(app: World) -> None:
    """A lease that nobody renews stops the run of a guarded axis."""
    async with app.bus() as bus:
        x = first(app)
        await x.enable()
        async with bus.watchdog(x, timeout=0.5, lease=0.6):
            await x.run(120.0)
            await app.sleep(1.2)


@_for_each_guarded
async def guarded_and_emergency(app: World) -> None:
    """An emergency stop inside of a watchdog block; enabled again; and on."""
    async with app.bus() as bus:
        x = first(app)
        await x.enable()
        async with bus.watchdog(x, timeout=0.5):
            await x.run(120.0)
            await bus.emergency_stop()
            bus.clear_emergency_stop()
            await x.enable()
            await x.move_by(0.2)
