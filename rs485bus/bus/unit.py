"""Plain Modbus for any device, and broadcasts, with pymodbus' method names."""

from __future__ import annotations

import math
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, Final, Literal, TypeVar, Unpack, overload

from rs485bus.arguments import choice, flag, instance, real
from rs485bus.bus.diagnostics import DiagnosticFunctions
from rs485bus.bus.functions import DataFunctions, ReadBack, RequestOptions
from rs485bus.bus.protocol import BusProtocol
from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.typed import TypedValues
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.errors import LimitExceeded
from rs485bus.wire import convert, functions
from rs485bus.wire.combining import spans
from rs485bus.wire.frames import (
    BROADCAST,
    HIGHEST_ADDRESS,
    MAX_ADDRESS,
    Request,
    unit_address,
    write_multiple,
    write_single,
)
from rs485bus.wire.private import Reply, private_request, reply_data
from rs485bus.wire.registers import Register, Repeat

T = TypeVar("T")
A = TypeVar("A")
B = TypeVar("B")
C = TypeVar("C")

_OPTIONS: Final = frozenset(RequestOptions.__optional_keys__)
_NEVER: Final = Repeat.NEVER


class Unit(DataFunctions, DiagnosticFunctions):
    """One device, as plain Modbus: all public functions of the specification, with pymodbus' method names.

    Every method takes, by keyword:

    - `timeout`: how long it may take, in seconds, from the call to its end: what still waits then is not sent, what is
      on the wire is not waited for any longer. 0 or less is over at once; None or infinity is no limit, but that for
      the port, if it is gone, nobody waits longer than 30 s.
    - `repeat`: whether it may be sent again when no reply comes: SAFE (what changes nothing), NEVER (what does), or
      VERIFY (a read-back tells whether it happened).
    - `urgency`: its place among the others, COMMAND unless it is said.
    - `reply_timeout`: how long the device may take to begin its answer, in seconds (0.001..10).
    - `pause`: how long the pair is quiet before the request, in seconds (0..1), where that is more than usual.

    The latter two hold for all requests where they are given to `bus.unit`. What would take the pair for longer than
    an armed watchdog allows is not sent.

    Every method raises `DeviceRefused`, `NotSent` (and what is derived from it), `NoReply` or `OutcomeUnknown`; and,
    before anything is sent, `ValueError` where an argument is out of its range and `TypeError` where it is of a wrong
    type.
    """

    DATATYPE = convert.DataType
    convert_from_registers = staticmethod(convert.convert_from_registers)
    convert_to_registers = staticmethod(convert.convert_to_registers)

    def __init__(self, bus: BusProtocol, address: int, *, allow_reserved_address: bool = False) -> None:
        self._bus = bus
        self.highest = HIGHEST_ADDRESS if flag("allow_reserved_address", allow_reserved_address) else MAX_ADDRESS
        self.address = unit_address(address, highest=self.highest)
        self._typed = TypedValues(self, self.share_time, self._attached)

    def __repr__(self) -> str:
        return f"<unit {self.address}>"

    # Typed values

    @overload
    async def read(
        self, register: Register[T], /, *, gap: int = ..., combine: bool | None = ..., **options: Unpack[RequestOptions]
    ) -> T: ...

    @overload
    async def read(
        self,
        first: Register[A],
        second: Register[B],
        /,
        *,
        gap: int = ...,
        combine: bool | None = ...,
        **options: Unpack[RequestOptions],
    ) -> tuple[A, B]: ...

    @overload
    async def read(
        self,
        first: Register[A],
        second: Register[B],
        third: Register[C],
        /,
        *,
        gap: int = ...,
        combine: bool | None = ...,
        **options: Unpack[RequestOptions],
    ) -> tuple[A, B, C]: ...

    @overload
    async def read(
        self, *registers: Register[Any], gap: int = ..., combine: bool | None = ..., **options: Unpack[RequestOptions]
    ) -> tuple[Any, ...]: ...

    async def read(
        self,
        *registers: Register[Any],
        gap: int = 0,
        combine: bool | None = None,
        **options: Unpack[RequestOptions],
    ) -> Any:
        """Read the typed value of a register, or those of several: `await unit.read(TEMPERATURE, HUMIDITY)`.

        Neighbours are read with one request. A device that refuses that is asked for each by itself from then on.

        Args:
            registers: made like `Register("temperature", I16, "°C", step=0.1, address=4)`.
            gap: how many registers that nobody asked for may lie between two that are read together.
            combine: whether neighbours may be read together; None: where the device's family allows it.
            options: as for every request; `timeout` is for all of them.

        Returns:
            The value of one register, a tuple of those of several.
        """
        values = await self._typed.read(registers, gap, combine, options)
        return values[0] if len(registers) == 1 else tuple(values)

    async def write(
        self,
        register: Register[T],
        value: T,
        *,
        function: Literal[6, 16] | None = None,
        **options: Unpack[RequestOptions],
    ) -> None:
        """Write the typed value of a register, checked against its range. `repeat` as for `write_register`.

        Args:
            register: made like `Register("level", F32, "mm", 0, 500, address=40)`.
            value: in the register's unit.
            function: 16 where the device takes no other, 6 for one register; None for 6 where it is one.
            options: as for every request.
        """
        await self._typed.write(register, value, function, options)

    # Any function

    async def request(
        self,
        function: int,
        data: bytes = b"",
        *,
        reply: Reply,
        writes: bool = True,
        **options: Unpack[RequestOptions],
    ) -> bytes:
        """Send a request by any function (1..127), a private one say; return the data of its answer.

        Args:
            function: the function code.
            data: what follows it, without the CRC.
            reply: how many bytes of data the answer has after the function code; or "counted" where its first byte
                tells how many follow it, "echo" where it repeats the request, a function that tells the number from
                the first bytes of the data (0 while it cannot be told yet), or None where nobody answers.
            writes: False for what changes nothing in the device: that is repeated when it is lost.
            options: as for every request.
        """
        request = private_request(self.address, function, data, reply, writes=writes, highest=self.highest)
        return reply_data(await self.ask(request, options))

    # How

    def ask(
        self, request: Request, options: RequestOptions, read_back: ReadBack | None = None
    ) -> Coroutine[Any, Any, bytes]:
        """Send a request; the coroutine returns the frame that answers it. `read_back` is for what is repeated by
        VERIFY."""
        if not options:
            return self._bus.ask(request, repeat=_NEVER, moves=True) if request.writes else self._bus.ask(request)
        unknown = options.keys() - _OPTIONS
        if unknown:
            known = ", ".join(f"{name}=" for name in sorted(_OPTIONS))
            raise TypeError(f"{min(unknown)}= is none of {known}, which requests take")
        usual = Repeat.NEVER if request.writes else Repeat.SAFE
        repeat = choice("repeat", options.get("repeat", usual), Repeat)
        verify = read_back() if repeat is Repeat.VERIFY and read_back is not None else None
        if repeat is Repeat.VERIFY and request.writes and verify is None:
            raise ValueError(
                f"function {request.function} cannot be verified: nothing can be read back that tells whether it was "
                "carried out. Repeat.SAFE repeats it blindly, Repeat.NEVER does not"
            )
        timeout, reply_timeout = options.get("timeout"), options.get("reply_timeout")
        pause = options.get("pause")
        return self._bus.ask(
            request,
            urgency=choice("urgency", options.get("urgency", Urgency.COMMAND), Urgency),
            timeout=None if timeout is None else real("timeout", timeout),
            repeat=repeat,
            moves=request.writes,
            reply_timeout=None if reply_timeout is None else reply_time(reply_timeout),
            pause=None if pause is None else quiet_time(pause),
            verify=verify,
        )

    def adjust(
        self, reply_timeout: float | None, pause: float | None, probe: Register[Any] | Literal[False] | None
    ) -> None:
        """Change what holds for all requests to it: see `bus.unit`."""
        if reply_timeout is None and pause is None and probe is None:
            return  # nobody has spoken to it yet: it is no unit that might be there
        state = self._bus.owner.units[self.address]
        waits = state.reply_timeout if reply_timeout is None else reply_time(reply_timeout)
        quiet = state.pause if pause is None else quiet_time(pause)
        if probe is not None and probe is not False:
            instance("probe", probe, Register, 'Register("status", U16, address=4), or be False')
            probe_request = spans([probe], combine=False)[0].request(self.address, self.highest)
        if (waits, quiet) != (state.reply_timeout, state.pause):
            self._bus.owner.gate.check_wait(state, waits, quiet)
            self._bus.owner.feeding.wait_longer(self.address, waits + quiet - state.reply_timeout - state.pause)
            state.reply_timeout, state.pause = waits, quiet
        if probe is not None:
            state.probe = probe_request if probe else False

    def share_time(self, options: RequestOptions) -> Callable[[], RequestOptions]:
        """For several requests that share one `timeout`: the options of the next one."""
        timeout = options.get("timeout")
        if timeout is None or real("timeout", timeout) == math.inf:
            return lambda: options
        ends = self._bus.now() + timeout

        def rest() -> RequestOptions:
            left: RequestOptions = {**options, "timeout": max(0.0, ends - self._bus.now())}
            return left

        return rest

    def _attached(self) -> DeviceAdapter | None:
        return self._bus.owner.units[self.address].attached


def reply_time(seconds: float) -> float:
    """How long a device may take to begin its answer, checked against its range."""
    return _seconds("reply_timeout", seconds, 0.001, 10)


def quiet_time(seconds: float) -> float:
    """How long the pair is quiet before a request, checked against its range."""
    return _seconds("pause", seconds, 0, 1)


def _seconds(name: str, value: float, low: float, high: float) -> float:
    number = real(name, value)
    if not low <= number <= high:
        raise LimitExceeded(f"{name} {number:g} s is outside {low:g}..{high:g} s")
    return number


class Units:
    """The units of a bus: one for an address, however often it is asked for.

    Args:
        bus: whose they are.
    """

    def __init__(self, bus: BusProtocol) -> None:
        self._bus = bus
        self._units: dict[int, Unit] = {}

    def at(self, address: int, allow_reserved_address: bool) -> Unit:
        """The unit at an address: see `bus.unit`."""
        unit = self._units.get(address) if type(address) is int and address <= MAX_ADDRESS else None
        if unit is None or allow_reserved_address is not False:
            unit = Unit(self._bus, address, allow_reserved_address=allow_reserved_address)
            unit = self._units.setdefault(unit.address, unit)
        return unit


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

    async def write_coil(self, address: int, value: bool, *, family: str | None = None) -> None:
        """Set or clear the coil at `address` of every device, function 05. As `write_register` otherwise."""
        await self._send(functions.write_coil(BROADCAST, address, value), family)

    async def write_coils(self, address: int, values: Sequence[bool], *, family: str | None = None) -> None:
        """Set or clear 1..1968 coils from `address` on, function 15. As `write_register` otherwise."""
        await self._send(functions.write_coils(BROADCAST, address, values), family)

    async def mask_write_register(
        self, address: int, and_mask: int = 0xFFFF, or_mask: int = 0, *, family: str | None = None
    ) -> None:
        """Set and clear bits of the register at `address` of every device, function 22, as `Unit` does.

        As `write_register` otherwise.
        """
        await self._send(functions.mask_write(BROADCAST, address, and_mask, or_mask), family)

    async def _send(self, request: Request, family: str | None) -> None:
        await self._bus.ask(request, repeat=Repeat.NEVER, family=family)
