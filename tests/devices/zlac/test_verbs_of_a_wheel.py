"""A wheel has the verbs of every axis: its status, and the clearing of its drive's errors; and no origin to find."""

import pytest

from rs485bus.devices.zlac.values import Fault
from rs485bus.errors import DriveFault
from rs485bus.motion.sample import AxisStatus
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant


@on_virtual_clock
async def test_a_wheel_tells_its_own_status() -> None:
    async with plant() as p:
        await p.base.move_to(1.0, 2.0)
        left, right = await p.base.left.status(), await p.base.right.status()
        assert isinstance(left, AxisStatus)
        assert (left.enabled, left.moving, left.faulty) == (True, False, False)
        assert (round(left.position, 2), round(right.position, 2)) == (1.0, 2.0)


@pytest.mark.parametrize("wheel", ["left", "right"])
@on_virtual_clock
async def test_either_wheel_clears_the_errors_of_its_drive(wheel: str) -> None:
    async with plant() as p:
        x = getattr(p.base, wheel)
        move = p.base.left.move_to(50.0)
        p.sim.left.fail(Fault.OVER_LOAD, p.now)
        with pytest.raises(DriveFault):
            await move
        assert (await p.base.left.status()).faulty
        await x.clear_fault()
        assert not (await p.base.left.status()).faulty
        await x.enable()
        await x.move_by(1.0)


@on_virtual_clock
async def test_what_clearing_does_not_clear_is_told_to_who_clears_it_on_a_wheel() -> None:
    async with plant(sim := WatchedZlac()) as p:
        sim.lasting = Fault.OVER_LOAD
        sim.right.fail(Fault.OVER_LOAD, p.now)
        with pytest.raises(DriveFault):
            await p.base.left.clear_fault()


@on_virtual_clock
async def test_who_wants_to_home_a_wheel_is_told_to_set_its_zero() -> None:
    async with plant() as p:
        assert not hasattr(p.base.left, "home")
        with pytest.raises(AttributeError, match=r"no origin to find.*set_zero\(\)"):
            p.base.left.home()  # type: ignore[attr-defined] # that is what is tried
        with pytest.raises(AttributeError, match="'ZlacWheel' object has no attribute 'hom'"):
            p.base.left.hom()  # type: ignore[attr-defined] # a slip
