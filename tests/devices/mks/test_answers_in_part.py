"""A drive that answers some of what it is asked, and not the rest, holds nobody up."""

from collections.abc import Callable
from contextlib import nullcontext

import anyio
import pytest

from rs485bus import open_bus
from rs485bus.devices.mks import MksServo
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import write
from rs485bus.errors import MotionError, StopUnconfirmed
from rs485bus.sim import SimMks, VirtualLine
from tests.devices.mks.bench import on_virtual_clock

_VERBS: dict[str, Callable[[MksServo], object]] = {
    "move": lambda axis: axis.move_by(3, rpm=60),
    "run": lambda axis: axis.run(60, duration=3),
}


class HalfHeard(SimMks):
    """From some time on its motor is let go of, and what has more than one register is not heard from it."""

    ill = False

    def receive(self, frame: bytes, now: float) -> bytes | None:
        if not self.ill or frame[:2] != bytes((self.address, 4)):
            return super().receive(frame, now)
        return super().receive(frame, now) if frame[4:6] == b"\0\1" else None


@pytest.mark.parametrize("guarded", [False, True])
@pytest.mark.parametrize("verb", _VERBS)
@on_virtual_clock
async def test_a_motor_that_was_let_go_of_and_does_not_say_where_it_is_ends_its_command(
    verb: str, guarded: bool
) -> None:
    sim = HalfHeard(1)
    with pytest.raises(BaseException) as left:  # noqa: PT011
        async with open_bus(VirtualLine(sim)) as bus:
            axis = MksServo(bus, 1)
            await axis.enable()
            await axis.position()
            async with bus.watchdog(axis, timeout=1.0) if guarded else nullcontext():
                command = _VERBS[verb](axis)
                await anyio.sleep(0.5)
                sim.ill = True
                sim.receive(write(1, r.ENABLE, False).adu, bus.now())  # by somebody else
                with anyio.fail_after(8), pytest.raises((MotionError, StopUnconfirmed)):
                    await command
                assert not sim.moving(bus.now())
    assert "could not be seen standing" in repr(left.value)


@on_virtual_clock
async def test_a_homing_of_a_motor_that_does_not_say_where_it_is_ends_before_its_own_time() -> None:
    sim = HalfHeard(1)
    with pytest.raises(BaseException) as left:  # noqa: PT011
        async with open_bus(VirtualLine(sim)) as bus:
            axis = MksServo(bus, 1)
            await axis.enable()
            homing = axis.home()
            await anyio.sleep(1.0)
            sim.ill = True
            with anyio.fail_after(3), pytest.raises(MotionError, match="did not tell where it is during home"):
                await homing
            assert not sim.moving(bus.now())
    assert "could not be seen standing" in repr(left.value)


@pytest.mark.parametrize("guarded", [False, True])
@on_virtual_clock
async def test_a_stream_to_a_motor_that_does_not_say_where_it_is_ends(guarded: bool) -> None:
    sim = HalfHeard(1)
    with pytest.raises(BaseException) as left:  # noqa: PT011
        async with open_bus(VirtualLine(sim)) as bus:
            axis = MksServo(bus, 1)
            await axis.enable()
            with anyio.fail_after(20):
                async with bus.watchdog(axis, timeout=1.0) if guarded else nullcontext(), axis.stream() as setpoint:
                    for turn in range(100):
                        setpoint(60)
                        await anyio.sleep(0.05)
                        if turn == 5:
                            sim.ill = True
                            sim.receive(write(1, r.ENABLE, False).adu, bus.now())  # by somebody else
    assert "could not be seen standing" in repr(left.value)
