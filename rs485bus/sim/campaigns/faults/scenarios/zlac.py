"""What applications do with both wheels of a ZLAC, and with a vehicle on them."""

from __future__ import annotations

from rs485bus import DifferentialDrive
from rs485bus.sim.campaigns.faults.scenario import scenario
from rs485bus.sim.campaigns.faults.world import World


@scenario("zlac", short=True)
async def both_wheels_move(app: World) -> None:
    """Both wheels go to positions together, and a way back."""
    async with app.bus():
        base = app.axis(1)
        await base.enable()
        await base.move_to(0.5, 0.5)
        await base.move_by(-0.3, 0.2)
        await base.left.position()
        await base.right.position()


@scenario("zlac")
async def both_wheels_run(app: World) -> None:
    """Both wheels turn, at other speeds, and stop."""
    async with app.bus():
        base = app.axis(1)
        await base.enable()
        await base.run(100.0, 100.0)
        await base.run(60.0, 120.0)
        await base.status()
        await base.stop()


@scenario("zlac")
async def wheels_apart(app: World) -> None:
    """Each wheel has a command of its own at the same time."""
    async with app.bus():
        base = app.axis(1)
        await base.enable()
        left = base.left.move_to(0.5)
        right = base.right.move_to(-0.4)
        await left
        await right


@scenario("zlac")
async def torque_then_stop(app: World) -> None:
    """Both wheels push, and stop."""
    async with app.bus():
        base = app.axis(1)
        await base.enable()
        await base.torque(800, 800)
        await app.sleep(0.2)
        await base.stop()
        await base.release()


@scenario("zlac")
async def vehicle_drives(app: World) -> None:
    """A vehicle drives a curve, asks where it is, and stops."""
    async with app.bus():
        base = app.axis(1, reverse=(False, True))
        vehicle = app.with_others(base, DifferentialDrive(base.real, 0.1, 0.5), "vehicle")
        await base.enable()
        for omega in (0.2, 0.4):
            await vehicle.drive(0.5, omega)
            await vehicle.update()
        await vehicle.stop()


@scenario("zlac")
async def both_wheels_stream(app: World) -> None:
    """Set-points for both wheels, one way and the other; the block is left while they turn."""
    async with app.bus():
        base = app.axis(1)
        await base.enable()
        async with base.stream(timeout=0.25) as setpoint:
            for left, right in ((60.0, 60.0), (90.0, 30.0), (-40.0, 40.0)):
                setpoint(left, right)
                await app.sleep(0.08)
        await base.move_by(0.2, 0.2)


@scenario("zlac")
async def guarded_vehicle_streams(app: World) -> None:
    """A guarded vehicle is driven by set-points, which end for a while and come again."""
    async with app.bus() as bus:
        base = app.axis(1, reverse=(False, True))
        vehicle = app.with_others(base, DifferentialDrive(base.real, 0.1, 0.5), "vehicle")
        await base.enable()
        async with bus.watchdog(base, timeout=0.5), vehicle.stream(timeout=0.2) as setpoint:
            setpoint(0.4, 0.2)
            await app.sleep(0.6)
            setpoint(0.2, -0.3)
            await app.sleep(0.1)


@scenario("zlac")
async def settings_then_run(app: World) -> None:
    """Clear faults, zero, set up, and run for a time."""
    async with app.bus():
        base = app.axis(1)
        await base.clear_faults()
        await base.set_zero()
        await base.set_up()
        await base.enable()
        await base.run(100.0, -100.0, duration=0.4)
