"""Several reads in flight over Modbus TCP, where that is asked for. Exact time."""

import asyncio

import pytest

from rs485bus import Bus, BusConfig, MksServo
from rs485bus.errors import DeviceRefused, NoReply
from rs485bus.sim import SimDevice, SimMks, SimUnit, VirtualLine
from rs485bus.transport.interface import Sink
from rs485bus.transport.modbus_tcp import _Unwrapped
from rs485bus.wire.crc import crc
from rs485bus.wire.mbap import Mbap
from tests.integration.support import virtual

TAKES = 0.01


class Server(VirtualLine):
    """Speaks Modbus TCP for some units, and serves all requests at once. Those that `lost` names are never answered."""

    gateway = True
    numbered = True

    def __init__(self, *units: SimDevice, native: bool = False) -> None:
        super().__init__()
        self.native = native
        self.units = {unit.address: unit for unit in units}
        self.asked: list[tuple[float, int]] = []
        self.most = self.out = 0
        self.lost: set[int] = set()
        self._mbap = Mbap()

    async def open(self, sink: Sink) -> None:
        await super().open(_Unwrapped(self._mbap, sink))

    def ask(self, data: bytes, asked: object) -> None:
        loop = asyncio.get_running_loop()
        frame = self._mbap.wrap(data, asked)
        self.asked.append((loop.time(), data[0]))
        if len(self.asked) in self.lost:
            return
        content = frame[6:]
        reply = self.units[content[0]].receive(content + crc(content), loop.time())
        if reply is not None:
            self.out += 1
            self.most = max(self.most, self.out)
            loop.call_later(TAKES, self._answer, frame[:4] + (len(reply) - 2).to_bytes(2, "big") + reply[:-2])

    def _answer(self, frame: bytes) -> None:
        self.out -= 1
        if self._sink is not None:
            self._sink.received(frame)


def unit(address: int) -> SimUnit:
    return SimUnit(address, {register: 100 * address + register for register in range(64)})


async def opened(line: VirtualLine, pipeline: int) -> Bus:
    bus = Bus(line, BusConfig(pipeline=pipeline))
    await bus.open()
    return bus


async def read_all(bus: Bus, addresses: range, count: int = 4) -> float:
    begun = asyncio.get_running_loop().time()
    reads = [bus.unit(address).read_holding_registers(n) for n in range(count) for address in addresses]
    wanted = [[100 * address + n] for n in range(count) for address in addresses]
    assert await asyncio.gather(*reads) == wanted
    return asyncio.get_running_loop().time() - begun


@virtual
async def test_reads_of_several_units_are_out_at_once_where_that_is_asked_for() -> None:
    for pipeline, takes in ((1, 16 * TAKES), (4, 4 * TAKES)):
        line = Server(*map(unit, range(1, 5)))
        bus = await opened(line, pipeline)
        assert await read_all(bus, range(1, 5)) == pytest.approx(takes, abs=0.002)
        assert line.most == pipeline
        await bus.aclose()


@virtual
async def test_behind_a_gateway_one_read_a_unit_is_out_and_to_a_device_itself_several() -> None:
    for native, most in ((False, 1), (True, 8)):
        line = Server(unit(1), native=native)
        bus = await opened(line, 8)
        await read_all(bus, range(1, 2), 16)
        assert line.most == most
        await bus.aclose()


@virtual
async def test_what_writes_goes_alone_and_keeps_its_turn() -> None:
    line = Server(*map(unit, range(1, 4)))
    bus = await opened(line, 8)
    before = [asyncio.ensure_future(bus.unit(n).read_holding_registers(5)) for n in (1, 2, 3)]
    await asyncio.sleep(0)
    write = asyncio.ensure_future(bus.unit(1).write_register(5, 7))
    after = [asyncio.ensure_future(bus.unit(n).read_holding_registers(5)) for n in (1, 2, 3)]
    assert [(await each)[0] for each in before] == [105, 205, 305]
    await write
    assert [(await each)[0] for each in after] == [7, 205, 305]
    times = [time for time, _ in line.asked]
    assert times[3] >= times[2] + TAKES
    assert times[4] >= times[3] + TAKES
    await bus.aclose()


@virtual
async def test_a_lost_answer_is_asked_for_again_and_one_that_never_comes_ends_as_no_reply() -> None:
    line = Server(*map(unit, range(1, 4)))
    line.lost = {2}
    bus = await opened(line, 3)
    await read_all(bus, range(1, 4), 1)
    assert bus.stats.units[2].retries == 1
    line.lost = set(range(100))
    with pytest.raises(NoReply):
        await bus.unit(1).read_holding_registers(1)
    await bus.aclose()


@virtual
async def test_an_exception_is_told_to_whom_it_answers() -> None:
    line = Server(unit(1), unit(2), native=True)
    bus = await opened(line, 4)
    wrong, right = await asyncio.gather(
        bus.unit(1).read_holding_registers(63, count=9),
        bus.unit(2).read_holding_registers(1),
        return_exceptions=True,
    )
    assert isinstance(wrong, DeviceRefused)
    assert right == [201]
    await bus.aclose()


@virtual
async def test_a_stop_does_not_wait_for_what_is_in_flight_and_drives_are_asked_one_at_a_time() -> None:
    line = Server(SimMks(9), *map(unit, range(1, 5)))
    bus = await opened(line, 4)
    x = MksServo(bus, 9)
    await x.enable()
    await x.run(60)
    reads = [asyncio.ensure_future(bus.unit(n).read_holding_registers(5)) for n in (1, 2, 3, 4)]
    await asyncio.sleep(0.001)
    asked = asyncio.get_running_loop().time()
    stop = x.stop()
    await asyncio.sleep(0.001)
    assert line.asked[-1][1] == 9
    assert line.asked[-1][0] < asked + 0.001
    await stop
    await asyncio.gather(*reads)
    await bus.aclose()


@virtual
async def test_closing_and_a_lost_port_end_what_is_in_flight() -> None:
    line = Server(unit(1), unit(2))
    line.lost = set(range(100))
    bus = await opened(line, 4)
    reads = [asyncio.ensure_future(bus.unit(n).read_holding_registers(5)) for n in (1, 2)]
    await asyncio.sleep(0.001)
    await bus.aclose()
    ends = await asyncio.wait_for(asyncio.gather(*reads, return_exceptions=True), 1.0)
    assert all(isinstance(end, NoReply) for end in ends)


def test_a_pipeline_has_its_range() -> None:
    with pytest.raises(ValueError, match="pipeline"):
        BusConfig(pipeline=0)
    with pytest.raises(ValueError, match="pipeline"):
        BusConfig(pipeline=17)
