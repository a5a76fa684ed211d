"""What applications do with TL-R steppers beside what all families can. The origin switch closes half a turn below."""

from __future__ import annotations

from rs485bus import MoveState
from rs485bus.devices.tlr import Homing, HomingMode
from rs485bus.sim.campaigns.faults.scenario import scenario
from rs485bus.sim.campaigns.faults.world import World

HOMING = Homing(mode=HomingMode.NEGATIVE_ORIGIN, rpm=200, creep_rpm=60, ramp_ms=20)


@scenario("tlr", short=True)
async def home_and_move(app: World) -> None:
    """Enable, home, go to a position, a distance back, ask where it is."""
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        await x.home(HOMING, timeout=10.0)
        await x.move_to(1.0)
        await x.move_by(-0.5)
        await x.position()


@scenario("tlr")
async def stop_while_homing(app: World) -> None:
    """Stop a homing under way, and home again."""
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        x.home(HOMING, timeout=10.0)
        await app.sleep(0.1)
        await x.stop()
        await x.enable()
        await x.home(HOMING, timeout=10.0)
        await x.move_to(0.2)


@scenario("tlr", may_differ=("retarget",))
async def retarget_under_way(app: World) -> None:
    """Change the target of a move under way."""
    async with app.bus():
        x = app.axis(1)
        await x.enable()
        move = x.move_to(2.0)
        await app.until(lambda: move.done() or move.state is MoveState.MOVING)
        await x.retarget(0.4)
        await move
        await x.position()


@scenario("tlr")
async def settings_then_move(app: World) -> None:
    """Settings that queue before a move, and questions."""
    async with app.bus():
        x = app.axis(1)
        await x.set_subdivision(8000)
        await x.set_soft_limits(-2.0, 2.0)
        await x.save()
        x.enable()
        x.set_zero()
        await x.move_to(0.4)
        await x.status()
        await x.version()
