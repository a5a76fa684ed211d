"""Plain Modbus for any device, and broadcasts, with pymodbus' method names."""

from __future__ import annotations

from collections.abc import Awaitable, Sequence

from rs485bus.arguments import choice, real
from rs485bus.bus.protocol import BusProtocol
from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.schedule.verification import Verification, holds
from rs485bus.wire.frames import (
    BROADCAST,
    Request,
    read_holding,
    read_input,
    registers,
    unit_address,
    write_multiple,
    write_single,
)
from rs485bus.wire.registers import Repeat


class Unit:
    """One device, as plain Modbus.

    `timeout` is how long the request may take, in seconds, from the call to its end: what still waits then is not sent,
    what is on the wire is not waited for any longer. 0 or less is over at once; None or infinity is no limit, but that
    for the port, if it is gone, nobody waits longer than 30 s.

    Every method raises `DeviceRefused`, `NotSent` (and what is derived from it), `NoReply` or `OutcomeUnknown`; and,
    before anything is sent, `ValueError` where an argument is out of its range and `TypeError` where it is of a wrong
    type.
    """

    def __init__(self, bus: BusProtocol, address: int) -> None:
        self._bus = bus
        self.address = unit_address(address)

    def __repr__(self) -> str:
        return f"<unit {self.address}>"

    async def read_holding_registers(
        self,
        address: int,
        count: int = 1,
        *,
        urgency: Urgency = Urgency.COMMAND,
        timeout: float | None = None,
        repeat: Repeat = Repeat.SAFE,
    ) -> list[int]:
        """Read `count` (1..125) registers from `address` (0..65535) on, function 03."""
        return registers(await self._ask(read_holding(self.address, address, count), urgency, timeout, repeat))

    async def read_input_registers(
        self,
        address: int,
        count: int = 1,
        *,
        urgency: Urgency = Urgency.COMMAND,
        timeout: float | None = None,
        repeat: Repeat = Repeat.SAFE,
    ) -> list[int]:
        """Read `count` (1..125) input registers from `address` (0..65535) on, function 04."""
        return registers(await self._ask(read_input(self.address, address, count), urgency, timeout, repeat))

    async def write_register(
        self,
        address: int,
        value: int,
        *,
        urgency: Urgency = Urgency.COMMAND,
        timeout: float | None = None,
        repeat: Repeat = Repeat.NEVER,
    ) -> None:
        """Write `value` (0..65535) to the register at `address`, function 06.

        It is sent once, unless `repeat` says otherwise: SAFE repeats it blindly, VERIFY reads the register back first.
        """
        await self._write(write_single(self.address, address, value), [value], urgency, timeout, repeat)

    async def write_registers(
        self,
        address: int,
        values: Sequence[int],
        *,
        urgency: Urgency = Urgency.COMMAND,
        timeout: float | None = None,
        repeat: Repeat = Repeat.NEVER,
    ) -> None:
        """Write 1..123 `values` to the registers from `address` on, function 16. `repeat` as for `write_register`."""
        await self._write(write_multiple(self.address, address, values), values, urgency, timeout, repeat)

    async def _write(
        self, request: Request, values: Sequence[int], urgency: Urgency, timeout: float | None, repeat: Repeat
    ) -> None:
        verify = holds(self.address, request.register, values) if repeat is Repeat.VERIFY else None
        await self._ask(request, urgency, timeout, repeat, moves=True, verify=verify)

    def _ask(
        self,
        request: Request,
        urgency: Urgency,
        timeout: float | None,
        repeat: Repeat,
        *,
        moves: bool = False,
        verify: Verification | None = None,
    ) -> Awaitable[bytes]:
        return self._bus.ask(
            request,
            urgency=choice("urgency", urgency, Urgency),
            timeout=None if timeout is None else real("timeout", timeout),
            repeat=choice("repeat", repeat, Repeat),
            moves=moves,
            verify=verify,
        )


class Broadcast:
    """Writes to every device on the pair. Nobody answers, so nobody knows who heard it.

    Args:
        bus: the bus.
    """

    def __init__(self, bus: BusProtocol) -> None:
        self._bus = bus

    async def write_register(self, address: int, value: int, *, family: str | None = None) -> None:
        """Write `value` (0..65535) to the register at `address` of every device, function 06.

        Returns when the turnaround after it is over. `family` names the family it is meant for ("MKS"), where devices
        of several are attached.

        Raises:
            BroadcastConflict: a device of another family would act on it.
        """
        await self._send(write_single(BROADCAST, address, value), family)

    async def write_registers(self, address: int, values: Sequence[int], *, family: str | None = None) -> None:
        """Write 1..123 `values` from `address` on, function 16. As `write_register` otherwise."""
        await self._send(write_multiple(BROADCAST, address, values), family)

    async def _send(self, request: Request, family: str | None) -> None:
        await self._bus.ask(request, repeat=Repeat.NEVER, family=family)
