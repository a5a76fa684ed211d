"""Who is told of the end of a request may make the next one from there."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rs485bus.bus.bus import Bus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.transport.alarm import LoopAlarm
from rs485bus.transport.interface import Sink
from rs485bus.wire.frames import crc, read_holding
from rs485bus.wire.timing import LineSettings
from tests.integration.support import virtual


def reply(value: int) -> bytes:
    head = bytes((1, 3, 2, 0, value))
    return head + crc(head)


class Gateway:
    """A TCP gateway, as far as a bus sees it: the test says what it answers."""

    name = "gateway"
    line = LineSettings(baudrate=115200)
    gateway = True
    unsent = 0

    def __init__(self) -> None:
        self.written: list[bytes] = []

    async def open(self, sink: Sink) -> None:
        pass

    def write(self, data: bytes) -> None:
        self.written.append(data)

    def abort(self) -> None:
        pass

    async def close(self) -> None:
        pass

    def alarm(self, callback: Callable[[], None]) -> LoopAlarm:
        return LoopAlarm(asyncio.get_running_loop(), callback)


@virtual
async def test_what_is_asked_then_is_not_answered_by_bytes_that_were_there_before() -> None:
    gateway = Gateway()
    bus = Bus(gateway, BusConfig(echo=False, tcp_gap=0.0))
    await bus.open()
    request = read_holding(1, 0, 1)
    second = Job(request)
    first = Job(request, on_end=lambda _: bus.submit(second))
    bus.submit(first)
    await asyncio.sleep(0.01)
    bus.received(2 * reply(7))
    assert first.outcome is Outcome.REPLY
    assert second.outcome is None
    await asyncio.sleep(0.01)
    assert len(gateway.written) == 2
    bus.received(reply(8))
    assert second.outcome is Outcome.REPLY
    assert second.reply[3:5] == b"\x00\x08"
    await bus.aclose()
