"""What is no truth value is refused before anything is sent: "no" and "off" would count as true."""

import asyncio
import inspect
from typing import Any

import pytest

from rs485bus import Bus, BusConfig, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.devices.mks import SingleTurnHoming
from rs485bus.devices.tlr import registers as tlr
from rs485bus.devices.zlac import registers as zlac
from rs485bus.sim import SimMks, SimTlr, SimUnit, SimZlac, VirtualLine
from tests.integration.support import virtual

GIVEN = {
    **{"rpm": 60.0, "left": 60.0, "right": 60.0, "milliamperes": 500, "coil": 0, "address": 0, "index": 0, "which": 1},
    **{"function": 0x41, "data": b"", "reply": 5, "on": True},
}
"""Arguments that may be given beside."""
REGISTERS = {TlrStepper: (tlr.INPUT_FILTER, 3), Zlac8015d: (zlac.SPEED_LIMIT, 500)}
NOT_ON_THE_BUS = {"halt"}
"""What layers call."""


def on(bus: Bus) -> list[Any]:
    y = TlrStepper(bus, 2)
    return [bus, bus.unit(7), MksServo(bus, 1), y, y.inputs, y.outputs, Zlac8015d(bus, 3)]


def truths() -> list[tuple[int, str, str]]:
    """Each public method that takes one, by which of the objects has it, and the argument's name."""

    async def look() -> list[tuple[int, str, str]]:
        async with open_bus(VirtualLine()) as bus:
            return [
                (at, name, parameter.name)
                for at, has in enumerate(on(bus))
                for name in dir(has)
                if not name.startswith("_") and name not in NOT_ON_THE_BUS
                if inspect.isfunction(method := inspect.getattr_static(has, name)) and name in dir(type(has))
                for parameter in inspect.signature(method).parameters.values()
                if parameter.annotation in ("bool", "bool | None")
            ]

    return asyncio.run(look())


@pytest.mark.parametrize(("at", "name", "argument"), truths())
@virtual
async def test_what_is_no_truth_is_refused_and_nothing_is_sent(at: int, name: str, argument: str) -> None:
    line = VirtualLine(SimMks(1), SimTlr(2), SimZlac(3), SimUnit(7, {0: 0}), baudrate=115200)
    async with open_bus(line, config=BusConfig(echo=False)) as bus:
        has = on(bus)[at]
        method = getattr(has, name)
        register, value = REGISTERS.get(type(has), (None, None))
        given = {"register": register, "value": value, **GIVEN, argument: "no"}
        taken = {key: given[key] for key in inspect.signature(method).parameters if key in given}
        if name == "read":
            taken = {argument: "no"}
        await asyncio.sleep(1.0)
        sent = line.pair.frames
        with pytest.raises(TypeError, match=r"must be (True or False|a number in 0\.\.1), not 'no'"):
            await (method(zlac.SPEED_LIMIT, **taken) if name == "read" else method(**taken))
        assert line.pair.frames == sent


@virtual
async def test_a_zero_that_is_perhaps_to_be_set_is_refused() -> None:
    line = VirtualLine(SimMks(1))
    async with open_bus(line, config=BusConfig(echo=False)) as bus:
        with pytest.raises(TypeError, match="set_zero_here must be True or False, not 'no'"):
            MksServo(bus, 1).home(SingleTurnHoming(set_zero_here="no"))  # type: ignore[arg-type]  # what is tried
        assert line.pair.frames == 0
