"""The five inputs and two outputs of a TL-R drive. Source: TL-R manual, 2.2.2, 3.5.2."""

from __future__ import annotations

from rs485bus.arguments import flag
from rs485bus.bus.handle import Handle
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.frames import read
from rs485bus.devices.tlr.parameters import TlrParameters
from rs485bus.devices.tlr.tables import Table
from rs485bus.devices.tlr.values import DiFunction, DoFunction, Ports
from rs485bus.errors import LimitExceeded
from rs485bus.motion.plan import Ask, Plan
from rs485bus.wire.frames import payload
from rs485bus.wire.registers import Register

PATHS_BY_INPUTS = (
    DiFunction.POSITION_TRIGGER,
    DiFunction.SELECT_0,
    DiFunction.SELECT_1,
    DiFunction.SELECT_2,
    DiFunction.SELECT_3,
)
"""DI0 to DI4, to go to paths by inputs (3.2.2)."""
SPEED_PATHS_BY_INPUTS = (DiFunction.SPEED_TRIGGER, *PATHS_BY_INPUTS[1:])
"""DI0 to DI4, to turn at speed paths by inputs (3.3)."""
SWITCHES = (DiFunction.ORIGIN, DiFunction.POSITIVE_LIMIT, DiFunction.NEGATIVE_LIMIT, DiFunction.NONE, DiFunction.NONE)
"""DI0 to DI4 as they are shipped, and as homing needs them (3.4.3)."""


class Inputs(Table[DiFunction]):
    """What the inputs do: `inputs[3] = DiFunction.STOP`.

    Where an input may set the motor in motion, its position may change without a command: that is no reason then to
    distrust it, as long as the drive has not restarted.
    """

    def __init__(self, parameters: TlrParameters) -> None:
        super().__init__(parameters, r.INPUT_FUNCTIONS, lambda function: (function,), DiFunction)

    def assign(self, *functions: DiFunction) -> Handle[None]:
        """Give all inputs their functions, from DI0 on; `PATHS_BY_INPUTS`, say. What is left out does nothing."""
        if len(functions) > r.INPUTS:
            raise LimitExceeded(f"{self._parameters.drive.name}: {len(functions)} functions for {r.INPUTS} inputs")
        filled = (*functions, *[DiFunction.NONE] * (r.INPUTS - len(functions)))
        return self._parameters.put(r.ALL_INPUT_FUNCTIONS, *filled)

    def set_polarity(self, index: int, *, normally_closed: bool) -> Handle[None]:
        """Whether an input is active while its contact is open."""
        return _set_bit(self._parameters, r.INPUT_POLARITY, index, len(self), normally_closed)

    def set_filter(self, coefficient: int) -> Handle[None]:
        """How much of bouncing is filtered out, of all inputs: 0..1024, 2 as shipped. Its unit is not said."""
        return self._parameters.put(r.INPUT_FILTER, coefficient)

    async def states(self) -> tuple[bool, ...]:
        """Which are on."""
        return _bits(await self._parameters.ask(r.INPUT_STATES), len(self))


class Outputs(Table[DoFunction]):
    """What the outputs tell: `outputs[1] = DoFunction.IN_POSITION`."""

    def __init__(self, parameters: TlrParameters) -> None:
        super().__init__(parameters, r.OUTPUT_FUNCTIONS, lambda function: (function,), DoFunction)

    def set_polarity(self, index: int, *, normally_closed: bool) -> Handle[None]:
        """Whether an output is open while it tells something."""
        return _set_bit(self._parameters, r.OUTPUT_POLARITY, index, len(self), normally_closed)

    def force(self, which: int, on: bool) -> Handle[None]:
        """Switch the output whose function is `DoFunction.FORCED_1`, 2 or 3."""
        return _set_bit(self._parameters, r.FORCED_OUTPUTS, which - 1, 3, on)

    async def states(self) -> tuple[bool, ...]:
        """Which are on."""
        return _bits(await self._parameters.ask(r.OUTPUT_STATES), len(self))


def _set_bit(parameters: TlrParameters, register: Register[Ports], index: int, count: int, on: bool) -> Handle[None]:
    if not 0 <= index < count:
        raise IndexError(f"{parameters.drive.name}: {index} is outside 0..{count - 1}")
    flag(register.name, on)

    def plan() -> Plan[None]:
        bits = register.decode(payload((yield Ask(read(parameters.drive.address, register)))))
        bit = Ports(1 << index)
        yield from parameters.drive.writer.put(register, bits | bit if on else bits & ~bit)

    return parameters.order(f"bit {index} of {register.name} = {on}", plan)


def _bits(ports: Ports, count: int) -> tuple[bool, ...]:
    return tuple(bool(ports & (1 << port)) for port in range(count))
