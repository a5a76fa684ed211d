"""Typed values of a unit: registers of a table, read with as few requests as the device allows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar

from rs485bus.arguments import flag, instance, whole
from rs485bus.bus.functions import DataFunctions, RequestOptions
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.errors import DeviceRefused
from rs485bus.wire.combining import Span, spans, words_of
from rs485bus.wire.registers import Register

T = TypeVar("T")

_NOT_TOGETHER = (2, 3)
"""The exceptions by which a device says that it does not take a block: illegal address, illegal value."""
_EXAMPLE = 'Register("temperature", I16, "°C", step=0.1, address=4)'


class TypedValues:
    """Reads and writes registers of a table.

    A device that refuses a block of neighbours is asked for each by itself from then on.

    Args:
        unit: the unit.
        share_time: as for `DiagnosticFunctions`.
        attached: what is known of the device; None where it is any.
    """

    def __init__(
        self,
        unit: DataFunctions,
        share_time: Callable[[RequestOptions], Callable[[], RequestOptions]],
        attached: Callable[[], DeviceAdapter | None],
    ) -> None:
        self._unit = unit
        self._share_time = share_time
        self._attached = attached
        self._refused: set[tuple[int, int, int]] = set()

    async def read(
        self, registers: tuple[Register[Any], ...], gap: int, combine: bool | None, options: RequestOptions
    ) -> list[Any]:
        """The values of some registers, in the order in which they are named."""
        if not registers:
            raise TypeError("read() takes one register or more: await unit.read(TEMPERATURE)")
        for register in registers:
            _check(register, "w", "read")
        whole("gap", gap, 0, 124)
        attached = self._attached()
        usual = attached is None or attached.combines_reads
        together = usual if combine is None else flag("combine", combine)
        only = None if attached is None else attached.read_function
        next_options = self._share_time(options)
        found: dict[int, Any] = {}
        for span in spans(registers, combine=together, gap=gap, function=only):
            for part in span.apart() if span[:3] in self._refused else [span]:
                found |= await self._read(part, next_options)
        return [found[place] for place in range(len(registers))]

    async def _read(self, span: Span, next_options: Callable[[], RequestOptions]) -> dict[int, Any]:
        try:
            return span.values(await self._ask(span, next_options))
        except DeviceRefused as refused:
            if len(span.members) == 1 or refused.code not in _NOT_TOGETHER:
                raise
        found: dict[int, Any] = {}
        for part in span.apart():
            found |= part.values(await self._ask(part, next_options))
        # They can be read one by one, so it was the block that was refused.
        self._refused.add(span[:3])
        return found

    def _ask(self, span: Span, next_options: Callable[[], RequestOptions]) -> Any:
        return self._unit.ask(span.request(self._unit.address, self._unit.highest), next_options())

    async def write(
        self, register: Register[T], value: T, function: Literal[6, 16] | None, options: RequestOptions
    ) -> None:
        """Write a value."""
        _check(register, "r", "written")
        if register.function == 4:
            raise ValueError(f"{register.name} is an input register (function 4): nothing writes to those")
        words = words_of(register, value)
        if function not in (None, 6, 16):
            raise ValueError(f"function {function!r} is neither 6 nor 16: those write registers")
        if function == 16 or len(words) > 1:
            if function == 6:
                raise ValueError(f"{register.name} takes {len(words)} registers: function 6 writes one")
            await self._unit.write_registers(register.address, words, **options)
        else:
            await self._unit.write_register(register.address, words[0], **options)


def _check(register: Register[Any], only: str, done: str) -> None:
    instance("register", register, Register, _EXAMPLE)
    if register.access == only:
        raise ValueError(f"{register.name} cannot be {done}: its access is {only!r}")
