"""Late replies behind Modbus TCP: what a transaction number proves of a gateway, and of a device itself. Exact time."""

import asyncio
from collections import deque

import pytest

from rs485bus import Bus, BusConfig, Repeat
from rs485bus.bus.line.numbered import NumberedReplies
from rs485bus.bus.schedule.job import Job
from rs485bus.errors import DeviceRefused, NoReply, OutcomeUnknown
from rs485bus.sim import SimUnit, VirtualLine
from rs485bus.transport.interface import Sink
from rs485bus.transport.modbus_tcp import _Unwrapped
from rs485bus.wire.crc import crc
from rs485bus.wire.frames import read_holding
from rs485bus.wire.mbap import Mbap
from tests.integration.support import virtual


class Gateway(VirtualLine):
    """Speaks Modbus TCP for a unit. Each request is answered after as many seconds as `delays` says, at once later."""

    gateway = True
    numbered = True

    def __init__(self, *delays: float, native: bool = False, baudrate: int = 115200) -> None:
        super().__init__(baudrate=baudrate)
        self.native = native
        self.unit = SimUnit(1, {register: 100 + register for register in range(64)})
        self.delays = deque(delays)
        self.asked: list[float] = []
        self._mbap = Mbap()

    async def open(self, sink: Sink) -> None:
        await super().open(_Unwrapped(self._mbap, sink))

    def ask(self, data: bytes, asked: object) -> None:
        loop = asyncio.get_running_loop()
        frame = self._mbap.wrap(data, asked)
        self.asked.append(loop.time())
        content = frame[6:]
        reply = self.unit.receive(content + crc(content), loop.time())
        if reply is not None and self._sink is not None:
            answer = frame[:4] + (len(reply) - 2).to_bytes(2, "big") + reply[:-2]
            loop.call_later(self.delays.popleft() if self.delays else 0.001, self._sink.received, answer)


async def opened(line: VirtualLine, **options: object) -> Bus:
    bus = Bus(line, BusConfig(**{"retries": 0, **options}))  # type: ignore[arg-type]
    await bus.open()
    return bus


@virtual
async def test_requests_follow_each_other_without_a_pause_and_without_a_question_about_echoes() -> None:
    line = Gateway(baudrate=9600)  # a frame takes 8 ms there; who answers sooner has had it sooner
    bus = await opened(line)
    begun = asyncio.get_running_loop().time()
    await bus.unit(1).write_register(5, 7)
    for _ in range(9):
        assert await bus.unit(1).read_holding_registers(5) == [7]
    assert asyncio.get_running_loop().time() - begun == pytest.approx(10 * 0.001, abs=0.0005)
    assert len(line.asked) == 10
    await bus.aclose()


@pytest.mark.parametrize("native", [False, True])
@virtual
async def test_an_answer_with_an_older_number_is_delivered_to_nobody_and_counted(native: bool) -> None:
    line = Gateway(7.0, native=native)
    bus = await opened(line)
    unit = bus.unit(1)
    with pytest.raises(NoReply):
        await unit.read_holding_registers(1)
    await asyncio.sleep(6.0)  # nothing is waited for any more, whichever rule holds
    line.unit.registers[1] = 999
    line.delays.append(1.5)
    assert await unit.read_holding_registers(1, reply_timeout=2.0) == [999]
    assert bus.stats.units[1].late_replies == 1
    await bus.aclose()


@virtual
async def test_behind_a_gateway_an_equal_request_waits_for_the_late_reply() -> None:
    line = Gateway(2.0)
    bus = await opened(line)
    with pytest.raises(NoReply):
        await bus.unit(1).read_holding_registers(1)
    sent = line.asked[0]
    assert await bus.unit(1).read_holding_registers(2) == [102]
    assert line.asked[-1] >= sent + 2.0
    await bus.aclose()


@virtual
async def test_a_device_that_speaks_it_itself_is_asked_again_at_once() -> None:
    line = Gateway(2.0, native=True)
    bus = await opened(line)
    with pytest.raises(NoReply):
        await bus.unit(1).read_holding_registers(1)
    begun = asyncio.get_running_loop().time()
    assert await bus.unit(1).read_holding_registers(2) == [102]
    assert asyncio.get_running_loop().time() - begun < 0.01
    await bus.aclose()


@pytest.mark.parametrize("native", [False, True])
@virtual
async def test_a_device_that_answers_later_than_an_attempt_lasts_is_understood_all_the_same(native: bool) -> None:
    line = Gateway(0.15, 0.15, 0.15, native=native)
    bus = await opened(line, retries=2)
    assert await bus.unit(1).read_holding_registers(1) == [101]
    await bus.aclose()


@virtual
async def test_a_device_that_is_slower_than_it_was_is_understood_while_others_are_asked() -> None:
    line = Gateway(native=True)
    bus = await opened(line)
    for _ in range(60):
        assert await bus.unit(1).read_holding_registers(1) == [101]
    line.delays.extend([0.09, 0.001, 0.09, 0.001, 0.09])
    answers = await asyncio.gather(*(bus.unit(1).read_holding_registers(register) for register in range(2, 7)))
    assert answers == [[102], [103], [104], [105], [106]]
    assert len(line.asked) == 65
    await bus.aclose()


@virtual
async def test_a_refusal_that_comes_late_is_no_answer() -> None:
    """While others are asked, the device says no to what waits to be sent again."""
    line = Gateway(*[0.1] * 4, native=True)
    bus = await opened(line, retries=2, reply_timeout=0.04)
    others = [asyncio.ensure_future(bus.unit(address).read_holding_registers(0)) for address in (2, 3)]  # nobody there
    await asyncio.sleep(0.001)
    with pytest.raises(DeviceRefused, match="02"):
        await bus.unit(1).read_holding_registers(999)
    await asyncio.gather(*others, return_exceptions=True)
    line.delays.clear()
    line.delays.extend([0.1] * 4)
    others = [asyncio.ensure_future(bus.unit(address).read_holding_registers(0)) for address in (4, 5)]
    with pytest.raises((DeviceRefused, OutcomeUnknown)):
        await bus.unit(1).write_register(999, 5, repeat=Repeat.SAFE)
    await asyncio.gather(*others, return_exceptions=True)
    assert line.unit.writes == []
    await bus.aclose()


def test_an_answer_to_a_request_that_was_sent_again_may_answer_its_first_attempt() -> None:
    replies = NumberedReplies()
    job = Job(read_holding(1, 0, 1))
    job.queued_at, job.sent_at = 1.0, 2.0
    assert replies.answered(job, 9.0) == 2.0
    job.unanswered = 1
    assert replies.answered(job, 9.0) == 1.0


@virtual
async def test_what_answers_a_broadcast_answers_nothing() -> None:
    line = Gateway()
    bus = await opened(line)
    await bus.broadcast.write_register(3, 9)
    assert line._sink is not None
    line._sink.received(bytes.fromhex("0001 0000 0006 00 06 0003 0009"))
    assert await bus.unit(1).read_holding_registers(3) == [9]
    await bus.aclose()
