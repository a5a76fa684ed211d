"""What is no number, or has no end, is refused by every verb of every family before anything is queued or sent."""

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.devices.axis import Axis
from rs485bus.devices.tlr import Path
from rs485bus.errors import LimitExceeded, NotSupported
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine
from tests.devices.stream_rig import FAMILIES, Make, rig
from tests.integration.support import virtual

VERBS: dict[str, Callable[[Axis, float], Awaitable[object]]] = {
    "move_to": lambda axis, value: axis.move_to(value),
    "move_by": lambda axis, value: axis.move_by(value),
    "run": lambda axis, value: axis.run(value),
    "rpm": lambda axis, value: axis.move_to(1.0, rpm=value),
    "duration": lambda axis, value: axis.run(10, duration=value),
    "acceleration": lambda axis, value: axis.move_to(1.0, acceleration=-abs(value)),
}


@asynccontextmanager
async def axes() -> AsyncIterator[tuple[list[Axis], Callable[[], int]]]:
    """One axis of each family, enabled, and how many writes went out so far."""
    async with open_bus(VirtualLine(SimMks(1), SimZlac(2), SimTlr(3))) as bus:
        all_axes: list[Axis] = [MksServo(bus, 1), Zlac8015d(bus, 2).left, TlrStepper(bus, 3)]
        for axis in all_axes:
            await axis.enable()
        writes: list[bytes] = []
        bus.subscribe(lambda record: writes.append(record.request) if record.request[1] in (6, 16) else None)
        yield all_axes, lambda: len(writes)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("verb", VERBS)
@virtual
async def test_what_is_not_finite_is_refused_at_the_call(verb: str, value: float) -> None:
    async with axes() as (all_axes, writes):
        for axis in all_axes:
            with pytest.raises(LimitExceeded):
                VERBS[verb](axis, value)
            assert await axis.idle()
        assert writes() == 0


@virtual
async def test_a_move_behind_one_that_is_not_planned_is_refused_at_the_call_too() -> None:
    async with axes() as (all_axes, _):
        for axis in all_axes:
            run = axis.run(10, duration=1.0)
            with pytest.raises(LimitExceeded):
                axis.move_by(math.nan)
            await run


@virtual
async def test_the_range_is_named_where_the_register_has_one() -> None:
    async with axes() as (all_axes, _):
        for axis in all_axes:
            with pytest.raises(LimitExceeded, match=r"position inf is outside -\d+.*\.\.\d+"):
                axis.move_to(math.inf)


@virtual
async def test_tables_of_a_drive_take_no_such_numbers_either() -> None:
    async with open_bus(VirtualLine(SimTlr(3))) as bus:
        stepper = TlrStepper(bus, 3)
        with pytest.raises(LimitExceeded):
            stepper.paths[0] = Path(math.nan)
        for limits in ((math.nan, 1.0), (-math.inf, math.inf)):
            with pytest.raises(LimitExceeded):
                await stepper.set_soft_limits(*limits)
        await asyncio.sleep(0.1)
        assert await stepper.idle()


@pytest.mark.parametrize("acceleration", [5e-324, 1e308])
@FAMILIES
@virtual
async def test_the_least_and_the_greatest_ramp_that_there_are_end_no_stream(make: Make, acceleration: float) -> None:
    async with rig(make) as on:
        on.axis.limits = (-5.0, 5.0)
        async with on.axis.stream(acceleration=acceleration) as setpoint:
            setpoint(100)
            await asyncio.sleep(0.1)
            setpoint(-100)
            await asyncio.sleep(0.1)


@pytest.mark.parametrize("limits", [(math.nan, 5.0), (0.0, math.nan), (5.0, 0.0), ("0", 5.0), (1.0,), 5.0, (True, 5.0)])
@virtual
async def test_limits_that_are_none_are_refused_when_they_are_set_later_as_well(limits: object) -> None:
    async with axes() as (all_axes, _):
        for axis in all_axes:
            axis.limits = (-1.0, 1.0)
            with pytest.raises((LimitExceeded, ValueError, TypeError), match=r"limits"):
                axis.limits = limits  # type: ignore[assignment]
            assert axis.limits == (-1.0, 1.0)
            with pytest.raises(LimitExceeded):
                await axis.move_to(2.0)
            axis.limits = None


@pytest.mark.parametrize("name", ["units_per_turn", "reverse", "tolerance"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1, 1.5, "1", None, []])
@virtual
async def test_what_an_axis_is_made_of_is_checked_when_it_is_set_later_as_well(name: str, value: object) -> None:
    if name == "units_per_turn" and value == 1.5:
        return
    async with axes() as (all_axes, writes):
        for axis in all_axes:
            before = getattr(axis, name)
            with pytest.raises((LimitExceeded, ValueError, TypeError), match=name):
                setattr(axis, name, value)
            assert getattr(axis, name) == before
        assert writes() == 0


@pytest.mark.parametrize("value", [1e308, -1e308])
@virtual
async def test_a_number_whose_counts_have_no_end_is_refused_as_one_out_of_range(value: float) -> None:
    async with axes() as (all_axes, writes):
        for axis in all_axes:
            verbs: list[Callable[[float], object]] = [axis.move_to, axis.move_by]
            if isinstance(axis, MksServo | TlrStepper):
                verbs += [axis.retarget, lambda at, axis=axis: axis.run(10, duration=abs(at))]
            for verb in verbs:
                with pytest.raises(LimitExceeded):
                    verb(value)
            with pytest.raises((LimitExceeded, NotSupported)):
                axis.watchdog(abs(value))
        assert writes() == 0


@pytest.mark.parametrize("limits", [(-1.0, math.inf), (-math.inf, 1.0), (-1e308, 1e308)])
@virtual
async def test_an_axis_with_an_end_on_one_side_only_runs_and_follows(limits: tuple[float, float]) -> None:
    async with axes() as (all_axes, _):
        for axis in all_axes:
            axis.limits = limits
            await axis.set_zero()
            await axis.run(30, duration=0.2)
            async with axis.stream() as setpoint:
                setpoint(30)
                await asyncio.sleep(0.2)
            assert await axis.position() > 0.05


@virtual
async def test_what_is_no_register_or_no_flag_is_named() -> None:
    wrong: Any
    line = VirtualLine(SimZlac(2), SimTlr(3))
    async with open_bus(line) as bus:
        base, stepper = Zlac8015d(bus, 2), TlrStepper(bus, 3)
        for wrong in (3, "speed", None):
            for call in (base.parameter, stepper.read):
                with pytest.raises(TypeError, match="register must be made like"):
                    await call(wrong)
            with pytest.raises(TypeError, match="register must be made like"):
                base.set_parameter(wrong, 1)
            with pytest.raises(TypeError, match="register must be made like"):
                stepper.write(wrong, 1)
            with pytest.raises(LimitExceeded, match="side"):
                await base.parameters(wrong)
        wrong = "no"
        with pytest.raises(TypeError, match="replace"):
            base.run(1, 1, replace=wrong)
        with pytest.raises(TypeError, match="replace"):
            stepper.run(1, replace=wrong)
        with pytest.raises(TypeError, match="torque"):
            base.torque(0, True)
        with pytest.raises(LimitExceeded, match="duration"):
            base.run(1, 1, duration=1e-12)
        assert line.pair.frames == 0
