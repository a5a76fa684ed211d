"""Requests of all functions a slave has, each judged by what the slave may hold."""

from __future__ import annotations

import asyncio
import random
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from rs485bus import Bus
from rs485bus.errors import DeviceRefused, NoReply, NotSent, OutcomeUnknown
from tests.real.counterparts.memory import Memory, Writing

UNIT = 5
WORKERS = 4
BLOCK = 16
"""Places that belong to one worker."""
REGISTERS = (3, 4, 6, 16)
BITS = (1, 2, 5, 15)


@dataclass
class Result:
    """What came of it."""

    requests: int = 0
    answered: int = 0
    wrong: int = 0
    restarts: int = 0
    functions: Counter[int] = field(default_factory=Counter)
    others: Counter[str] = field(default_factory=Counter)

    def __str__(self) -> str:
        functions = " ".join(f"{function}:{count}" for function, count in sorted(self.functions.items()))
        rest = ", ".join(f"{count} {what}" for what, count in self.others.items()) or "none otherwise"
        return (
            f"{self.requests} requests, {self.answered} answered, {self.wrong} wrong, {self.restarts} restarts; "
            f"{rest}; by function {functions}"
        )


class Worker:
    """One of several that ask at the same time, each with places of its own."""

    def __init__(self, bus: Bus, number: int, memory: Memory, result: Result, functions: tuple[int, ...]) -> None:
        self._unit = bus.unit(UNIT)
        self._first = number * BLOCK
        self._memory = memory
        self._result = result
        self._random = random.Random(number)
        self._known: dict[int, Callable[[], Awaitable[None]]] = {
            1: lambda: self._read_bits("coil", self._unit.read_coils),
            2: lambda: self._read_bits("input", self._unit.read_discrete_inputs),
            3: lambda: self._read_words("register", self._unit.read_holding_registers),
            4: lambda: self._read_words("input register", self._unit.read_input_registers),
            5: self._write_coil,
            6: self._write_register,
            7: self._status,
            8: self._diagnose,
            11: self._event_counter,
            12: self._event_log,
            15: self._write_coils,
            16: self._write_registers,
            17: self._server_id,
            20: self._read_file,
            21: self._write_file,
            22: self._mask_write,
            23: self._read_write,
            24: self._read_queue,
            43: self._identify,
        }
        self._functions = functions

    async def work(self, ends: Callable[[], bool]) -> None:
        while not ends():
            function = self._random.choice(self._functions)
            self._result.requests += 1
            self._result.functions[function] += 1
            try:
                await self._known[function]()
                self._result.answered += 1
            except (NoReply, OutcomeUnknown, NotSent) as error:
                self._result.others[type(error).__name__] += 1
                await asyncio.sleep(0.2)  # it is being restarted

    def _judge(self, right: bool) -> None:
        self._result.wrong += not right

    def _window(self, most: int = 8) -> tuple[int, int]:
        count = self._random.randint(1, most)
        return self._first + self._random.randint(0, BLOCK - count), count

    async def _read_bits(self, kind: str, read: Callable[[int, int], Awaitable[list[bool]]]) -> None:
        first, count = self._window(BLOCK)
        restarts = self._memory.restarts
        values = await read(first, count)
        self._judge(len(values) == count)
        self._result.wrong += self._memory.read(kind, first, values, restarts)

    async def _read_words(self, kind: str, read: Callable[[int, int], Awaitable[list[int]]]) -> None:
        first, count = self._window(BLOCK)
        restarts = self._memory.restarts
        values = await read(first, count)
        self._judge(len(values) == count)
        self._result.wrong += self._memory.read(kind, first, values, restarts)

    @contextmanager
    def _writing(self, kind: str, first: int, values: list[int]) -> Iterator[None]:
        restarts = self._memory.restarts
        writing = self._memory.writing(kind, first, [lambda _, value=value: value for value in values])  # type: ignore[misc] # each its own
        with self._ending(writing, restarts):
            yield

    @contextmanager
    def _ending(self, writing: Writing, restarts: int) -> Iterator[None]:
        try:
            yield
        except (NotSent, DeviceRefused):
            writing.not_done(self._memory.is_sure(restarts))
            raise
        except OutcomeUnknown:
            writing.unknown()
            raise
        writing.done(self._memory.is_sure(restarts))

    async def _write_coil(self) -> None:
        first, value = self._window()[0], self._random.random() < 0.5
        with self._writing("coil", first, [value]):
            await self._unit.write_coil(first, value)

    async def _write_coils(self) -> None:
        first, count = self._window()
        values = [self._random.random() < 0.5 for _ in range(count)]
        with self._writing("coil", first, list(values)):
            await self._unit.write_coils(first, values)

    async def _write_register(self) -> None:
        first, value = self._window()[0], self._random.randrange(0x10000)
        with self._writing("register", first, [value]):
            await self._unit.write_register(first, value)

    async def _write_registers(self) -> None:
        first, count = self._window()
        values = [self._random.randrange(0x10000) for _ in range(count)]
        with self._writing("register", first, values):
            await self._unit.write_registers(first, values)

    async def _mask_write(self) -> None:
        first, masks = self._window()[0], [self._random.randrange(0x10000) for _ in range(2)]
        and_mask, or_mask = masks
        restarts = self._memory.restarts
        writing = self._memory.writing("register", first, [lambda old: old & and_mask | or_mask & ~and_mask])
        with self._ending(writing, restarts):
            await self._unit.mask_write_register(first, and_mask, or_mask)

    async def _read_write(self) -> None:
        first, count = self._window()
        values = [self._random.randrange(0x10000) for _ in range(count)]
        restarts = self._memory.restarts
        with self._writing("register", first, values):
            seen = await self._unit.readwrite_registers(first, count, first, values)
        self._judge(seen == values)
        self._result.wrong += self._memory.read("register", first, seen, restarts)

    async def _status(self) -> None:
        self._judge(0 <= await self._unit.read_exception_status() <= 255)

    async def _diagnose(self) -> None:
        data = self._random.randbytes(2)
        self._judge(await self._unit.diag_query_data(data) == data)
        self._judge(0 <= await self._unit.diag_read_bus_message_count() <= 0xFFFF)

    async def _event_counter(self) -> None:
        self._judge(0 <= (await self._unit.diag_get_comm_event_counter()).events <= 0xFFFF)

    async def _event_log(self) -> None:
        self._judge(len((await self._unit.diag_get_comm_event_log()).log) <= 64)

    async def _server_id(self) -> None:
        self._judge(len(await self._unit.report_device_id()) > 1)

    async def _read_file(self) -> None:
        # pymodbus' server answers these ten registers, whatever is asked for.
        (values,) = await self._unit.read_file_record([(4, self._random.randrange(100), 10)])
        self._judge(b"".join(value.to_bytes(2, "big") for value in values) == b"SERVER DUMMY RECORD.")

    async def _write_file(self) -> None:
        values = [self._random.randrange(0x10000) for _ in range(4)]
        await self._unit.write_file_record([(4, 1, values)])

    async def _read_queue(self) -> None:
        self._judge(await self._unit.read_fifo_queue(3) == [0, 1, 2, 3])  # pymodbus' server has no other

    async def _identify(self) -> None:
        self._judge(0 in (await self._unit.read_device_information()).information)


async def exercise(
    bus: Bus,
    functions: tuple[int, ...],
    requests: int,
    restarts: int,
    restart: Callable[[], Awaitable[None]],
) -> Result:
    """Ask so often, and have the slave restarted so often in the middle."""
    memory, result = Memory(), Result()
    workers = [Worker(bus, number, memory, result, functions) for number in range(WORKERS)]
    asking = [asyncio.ensure_future(worker.work(lambda: result.requests >= requests)) for worker in workers]
    try:
        for number in range(restarts):
            while result.requests < requests * (number + 1) // (restarts + 1):
                if all(task.done() for task in asking):
                    break
                await asyncio.sleep(0.01)
            with memory.restarting():
                await restart()
            result.restarts += 1
        await asyncio.gather(*asking)
    finally:
        for task in asking:
            task.cancel()
    return result
