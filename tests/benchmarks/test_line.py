"""The paced line counts what began too early and answers what it understands. No test looks at a clock."""

import os
import threading
import tty
from collections.abc import Iterator

import pytest

from benchmarks.line import PacedLine
from benchmarks.setting import MARK, Setting
from rs485bus.wire.frames import read_holding, registers, write_multiple, write_single

SETTING = Setting(baudrate=115200)
READ = read_holding(1, 0, 3)
START = 1_000_000_000


@pytest.fixture
def line() -> Iterator[PacedLine]:
    line = PacedLine(SETTING, spin=False)
    yield line
    line.close()


def nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)


AIR = nanoseconds(SETTING.line.airtime(len(READ.adu)))
SILENCE = nanoseconds(SETTING.line.t35)


def test_a_frame_after_the_silence_is_not_early(line: PacedLine) -> None:
    line.heard(READ.adu, START)
    line.heard(READ.adu, START + AIR + SILENCE + 1000)
    assert (line.frames, line.early) == (2, 0)


def test_the_silence_counts_from_the_end_of_the_airtime(line: PacedLine) -> None:
    line.heard(READ.adu, START)
    line.heard(READ.adu, START + AIR + SILENCE - 1000)
    assert (line.frames, line.early) == (2, 1)


def test_a_frame_while_a_unit_answers_is_early(line: PacedLine) -> None:
    line.heard(READ.adu, START)
    line.heard(READ.adu, START + AIR + nanoseconds(SETTING.turnaround) + 1000)
    assert line.early == 1


def test_a_frame_that_arrives_in_pieces_is_one(line: PacedLine) -> None:
    line.heard(READ.adu[:3], START)
    line.heard(READ.adu[3:], START + 300_000)
    assert (line.frames, line.early) == (1, 0)


def test_what_is_torn_is_not_continued_after_a_silence(line: PacedLine) -> None:
    line.heard(READ.adu[:3], START)
    line.heard(READ.adu, START + 10 * SILENCE)
    assert line.frames == 2


def test_a_mark_is_told_with_its_time(line: PacedLine) -> None:
    line.heard(write_multiple(1, MARK, [7, 0]).adu, START)
    assert line.marks == [(START / 1e9, 7)]


def test_it_answers_over_a_real_pseudo_terminal(line: PacedLine) -> None:
    serving = threading.Thread(target=line.run)
    serving.start()
    client = os.open(line.port, os.O_RDWR | os.O_NOCTTY)
    try:
        tty.setraw(client)
        os.write(client, READ.adu)
        assert registers(os.read(client, 100)) == [1, 1, 1]
        single = write_single(2, 5, 6).adu
        os.write(client, single)
        assert os.read(client, 100) == single
        block = write_multiple(31, 5, [6, 7])
        os.write(client, block.adu)
        reply = os.read(client, 100)
        assert len(reply) == block.length
        assert reply.startswith(block.prefix)
    finally:
        line.stopped = True
        serving.join()
        os.close(client)


def test_the_limit_is_the_one_of_the_design() -> None:
    assert Setting(baudrate=115200, turnaround=0.002).limit == pytest.approx(180.8, abs=0.1)
