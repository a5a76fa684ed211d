"""What applications do with MKS servos beside what all families can. The origin switch closes half a turn below."""

from __future__ import annotations

from rs485bus import MoveState
from rs485bus.devices.mks import HoldingCurrent, SwitchHoming
from rs485bus.devices.mks.provisioning import set_address
from rs485bus.sim.campaigns.faults.scenario import scenario
from rs485bus.sim.campaigns.faults.world import World

HOMING = SwitchHoming(rpm=200)
_SETTINGS = ("set_current", "set_holding_current", "set_microsteps", "set_interpolation")


@scenario("mks", short=True)
async def home_and_move(app: World) -> None:
    """Enable, home, go to a position, a distance back, ask where it is."""
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        await x.home(HOMING, timeout=10.0)
        await x.move_to(1.0)
        await x.move_by(-0.5)
        await x.position()


@scenario("mks")
async def home_with_limits(app: World) -> None:
    """Home with the limit switches on, run away from the switch, and back to zero (5.2)."""
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        await x.home(SwitchHoming(rpm=200, end_limits=True), timeout=10.0)
        await x.move_to(0.6)
        await x.return_to_zero(timeout=10.0)


@scenario("mks")
async def stop_while_homing(app: World) -> None:
    """Stop a homing under way, and home again."""
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        x.home(SwitchHoming(rpm=60), timeout=10.0)
        await app.sleep(0.25)
        await x.stop()
        await x.enable()
        await x.home(HOMING, timeout=10.0)
        await x.move_to(0.2)


@scenario("mks", may_differ=("retarget",))
async def retarget_under_way(app: World) -> None:
    """Change the target of a move under way (9.4)."""
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        move = x.move_to(2.0)
        await app.until(lambda: move.done() or move.state is MoveState.MOVING)
        await x.retarget(0.4)
        await move
        await x.position()


@scenario("mks", short=True)
async def by_pulses_and_counts(app: World) -> None:
    """The relative commands of 9.1 and 9.3, and the absolute one of 9.2."""
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        await x.move_by_pulses(1600)
        await x.move_by_counts(-4096)
        await x.move_to_pulses(800)


@scenario("mks")
async def settings_then_move(app: World) -> None:
    """Settings that queue before a move, and questions."""
    async with app.bus():
        x = app.axis(1)
        await x.set_current(1200, save=False)
        await x.set_holding_current(HoldingCurrent.PERCENT_30)
        await x.set_interpolation(True)
        x.enable()
        x.set_zero()
        await x.move_to(0.4)
        await x.status()
        await x.encoder()
        await x.inputs()
        await x.homed()
        await x.pulses()


@scenario("mks", may_differ=("restart",))
async def restart_on_request(app: World) -> None:
    """Restart the drive by its command, and set it up again."""
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        await x.move_to(0.3)
        await x.restart()
        await x.enable()
        await x.set_zero()
        await x.move_by(0.3)


@scenario("mks")
async def provisioned_and_moved(app: World) -> None:
    """A new address, and the old one again, on a drive alone on its pair; then it is moved."""
    await app.record("provisioning", "set_address", set_address(lambda _: app.line(), 5, address=1))
    await app.record("provisioning", "set_address", set_address(lambda _: app.line(), 1, address=5))
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        await x.move_to(0.2)
