"""Frames that nobody here asked for give another master away. What is ours, or may be late, does not."""

import asyncio

import pytest

from rs485bus import BusConfig, open_bus
from rs485bus.bus.line.strangers import MANY, WITHIN, Strangers
from rs485bus.errors import NoReply
from rs485bus.sim import SimUnit, VirtualLine
from rs485bus.wire.crc import crc
from tests.integration.support import virtual


def answer(address: int, value: int) -> bytes:
    body = bytes((address, 3, 2, 0, value))
    return body + crc(body)


class Counting(Strangers):
    """Counts how often many were noticed."""

    __slots__ = ("times",)

    def __init__(self) -> None:
        super().__init__()
        self.times = 0
        self.found = self._count

    def _count(self) -> None:
        self.times += 1

    def hear(self, *pieces: bytes, every: float = 0.1) -> int:
        for number, piece in enumerate(pieces):
            self.heard(piece, 100 + number * every, follows_silence=True)
        return self.times


FOREIGN = [answer(2, value) for value in range(MANY)]


def test_so_many_frames_within_a_while_are_noticed() -> None:
    assert Counting().hear(*FOREIGN[1:]) == 0
    assert Counting().hear(*FOREIGN) == 1
    assert Counting().hear(b"".join(FOREIGN)) == 1
    assert Counting().hear(*FOREIGN, every=WITHIN) == 0


def test_a_frame_that_comes_in_pieces_is_one_and_noise_is_none() -> None:
    strangers = Counting()
    for frame in FOREIGN:
        strangers.heard(frame[:3], 100, follows_silence=True)
        strangers.heard(frame[3:], 100, follows_silence=False)
    assert strangers.times == 1
    assert Counting().hear(*(frame[:-1] + b"\xff" for frame in FOREIGN)) == 0
    assert Counting().hear(*(bytes([byte]) * 3 for byte in range(256))) == 0


def test_what_comes_twice_or_late_or_answers_a_broadcast_is_no_strangers() -> None:
    twice, late, all_of_them = Counting(), Counting(), Counting()
    for frame in FOREIGN:
        twice.sent_or_answered(frame)
    late.unanswered(b"\x02\x03", 90)
    all_of_them.unanswered(b"\x00\x03", 90)
    assert [each.hear(*FOREIGN) for each in (twice, late, all_of_them)] == [0, 0, 0]


@pytest.mark.parametrize("with_ours", [False, True])
@virtual
async def test_another_master_is_told_of_once_and_named_where_nothing_answers(
    with_ours: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Also where its answers come while this program asks without a pause."""
    line = VirtualLine(SimUnit(1, {0: 7}))
    async with open_bus(line, config=BusConfig(echo=False)) as bus:
        for frame in FOREIGN + FOREIGN:
            ours = asyncio.create_task(bus.unit(1).read_holding_registers(0))
            await asyncio.sleep(0.001 if with_ours else 0.1)
            assert line._sink is not None
            line._sink.received(frame)
            assert await ours == [7]
        told = [record.getMessage() for record in caplog.records if "Somebody else asks" in record.getMessage()]
        assert len(told) == 1
        with pytest.raises(NoReply, match="Somebody else asks on virtual line"):
            await bus.unit(3).read_holding_registers(0)
