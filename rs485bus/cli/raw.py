"""`rs485bus read` and `rs485bus write`: registers and coils of any Modbus device, with types."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from dataclasses import dataclass

from rs485bus.bus.unit import Broadcast, Unit
from rs485bus.cli.process import DONE, WrongUse, console
from rs485bus.cli.session import Where, open_line
from rs485bus.errors import DeviceRefused, NoReply
from rs485bus.wire.convert import DataType, WordOrder, convert_from_registers, convert_to_registers
from rs485bus.wire.registers import Repeat

TYPES = {
    "u16": DataType.UINT16,
    "i16": DataType.INT16,
    "u32": DataType.UINT32,
    "i32": DataType.INT32,
    "u64": DataType.UINT64,
    "i64": DataType.INT64,
    "f32": DataType.FLOAT32,
    "f64": DataType.FLOAT64,
    "string": DataType.STRING,
}
TABLES = ("holding", "input", "coil", "discrete")
_ON, _OFF = ("1", "on", "true"), ("0", "off", "false")

Value = bool | int | float | str


@dataclass(frozen=True, slots=True, kw_only=True)
class What:
    """Which values of a device."""

    address: int
    register: int
    table: str = "holding"
    kind: str = "u16"
    order: str = "big"
    count: int = 1

    def check(self, *, writes: bool) -> None:
        """Refuse what cannot be meant. Raises `WrongUse`."""
        if self.table not in TABLES:
            raise WrongUse(f"There is no table {self.table!r}. There is: {', '.join(TABLES)}.")
        if self.kind not in TYPES:
            raise WrongUse(f"There is no type {self.kind!r}. There is: {', '.join(TYPES)}.")
        if self.order not in ("big", "little"):
            raise WrongUse(f"--word-order is big (high word first) or little, not {self.order!r}.")
        if self.of_bits and self.kind != "u16":
            raise WrongUse(f"A {self.table} is a bit: it has no --type.")
        if writes and self.table in ("input", "discrete"):
            raise WrongUse(f"Nothing can be written to the table {self.table}: it is holding or coil.")
        if not 0 <= self.address <= 247 or (self.address == 0 and not writes):
            raise WrongUse(f"address {self.address} is outside 1..247 (0, which is everybody's, can be written to)")

    @property
    def _order(self) -> WordOrder:
        return "little" if self.order == "little" else "big"

    @property
    def of_bits(self) -> bool:
        """Whether each value is one bit."""
        return self.table in ("coil", "discrete")

    @property
    def words(self) -> int:
        """How many registers one value takes; for text, how many there are."""
        return max(1, TYPES[self.kind].value[1])

    def decoded(self, registers: Sequence[int]) -> list[Value]:
        """The values that registers hold."""
        if self.kind == "string":
            text = convert_from_registers(list(registers), DataType.STRING, self._order)
            return [str(text).rstrip("\0")]
        size = self.words
        pieces = [list(registers[at : at + size]) for at in range(0, len(registers), size)]
        return [convert_from_registers(piece, TYPES[self.kind], self._order) for piece in pieces]  # type: ignore[misc]

    def encoded(self, texts: Sequence[str]) -> list[int]:
        """The registers that hold some values. Raises `WrongUse` for what is no such value."""
        registers: list[int] = []
        for text in texts:
            try:
                value: Value = text if self.kind == "string" else _number(text, self.kind)
                registers += convert_to_registers(value, TYPES[self.kind], self._order)
            except (ValueError, OverflowError) as error:
                raise WrongUse(f"{text!r} is no {self.kind}: {error}") from None
        return registers


def _number(text: str, kind: str) -> int | float:
    if kind.startswith("f"):
        return float(text)
    return int(text, 0)


def parse_number(text: str, what: str) -> int:
    """Read 8193 or 0x2001. Raises `WrongUse`."""
    try:
        number = int(text, 0)
    except ValueError:
        raise WrongUse(f"{what} {text!r} is no number; write it like 8193 or 0x2001") from None
    if not 0 <= number <= 0xFFFF:
        raise WrongUse(f"{what} {text} is outside 0..65535")
    return number


async def run_read(where: Where, bus_name: str | None, what: What, every: float | None, as_json: bool) -> int:
    """Read once, or again and again until interrupted, and print it."""
    async with open_line(where, bus_name) as bus:
        while True:
            try:
                values = await _read(bus.unit(what.address), what)
            except (NoReply, DeviceRefused) as error:
                _advise(error, what)
                if every is None:
                    raise
                console().print(f"{type(error).__name__}: {error}")
            else:
                _print(what, values, as_json)
            if every is None:
                return DONE
            await asyncio.sleep(every)


async def _read(unit: Unit, what: What) -> list[Value]:
    if what.table == "coil":
        return list(await unit.read_coils(what.register, what.count))
    if what.table == "discrete":
        return list(await unit.read_discrete_inputs(what.register, what.count))
    read = unit.read_holding_registers if what.table == "holding" else unit.read_input_registers
    return what.decoded(await read(what.register, what.count * what.words))


def _print(what: What, values: list[Value], as_json: bool) -> None:
    if as_json:
        told = {"address": what.address, "table": what.table, "register": what.register, "type": what.kind}
        if what.of_bits:
            del told["type"]
        print(json.dumps({**told, "values": values}), flush=True)
        return
    step = 1 if what.of_bits else what.words
    for at, value in enumerate(values):
        register = what.register + at * step
        hexadecimal = f"  0x{value:04X}" if type(value) is int and value >= 0 else ""
        print(f"{register:5d} 0x{register:04X}  {_shown(value)}{hexadecimal}", flush=True)


def _shown(value: Value) -> str:
    return (
        ("on" if value else "off")
        if isinstance(value, bool)
        else f"{value:.9g}"
        if isinstance(value, float)
        else str(value)
    )


async def run_write(
    where: Where, bus_name: str | None, what: What, texts: Sequence[str], *, multiple: bool, verify: bool
) -> int:
    """Write some values, once, and say so."""
    bits = [_bit(text) for text in texts] if what.of_bits else []
    registers = [] if what.of_bits else what.encoded(texts)
    async with open_line(where, bus_name) as bus:
        repeat = Repeat.VERIFY if verify else Repeat.NEVER
        single = not multiple and len(bits or registers) == 1
        if what.address == 0:
            await _broadcast(bus.broadcast, what, bits, registers, single)
        elif what.of_bits and single:
            await bus.unit(what.address).write_coil(what.register, bits[0], repeat=repeat)
        elif what.of_bits:
            await bus.unit(what.address).write_coils(what.register, bits, repeat=repeat)
        elif single:
            await bus.unit(what.address).write_register(what.register, registers[0], repeat=repeat)
        else:
            await bus.unit(what.address).write_registers(what.register, registers, repeat=repeat)
    print("Sent to all; nobody answers a broadcast." if what.address == 0 else f"Written to unit {what.address}.")
    return DONE


async def _broadcast(everybody: Broadcast, what: What, bits: list[bool], registers: list[int], single: bool) -> None:
    if what.of_bits:
        await everybody.write_coils(what.register, bits)
    elif single:
        await everybody.write_register(what.register, registers[0])
    else:
        await everybody.write_registers(what.register, registers)


def _bit(text: str) -> bool:
    if text.lower() in _ON + _OFF:
        return text.lower() in _ON
    raise WrongUse(f"{text!r} is neither on nor off")


def _advise(error: Exception, what: What) -> None:
    unknown_function = isinstance(error, NoReply) or (isinstance(error, DeviceRefused) and error.code == 1)
    if what.table == "holding" and unknown_function and not getattr(error, "__notes__", None):
        error.add_note(
            "Some devices are read by function 04 only, MKS drives among them: --table input. "
            "rs485bus scan tells which family answers where."
        )
