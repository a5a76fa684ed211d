"""Less silence between frames than Modbus asks for, where somebody asks for that. Exact time."""

import asyncio
import itertools
import logging

import pytest

from rs485bus import BusConfig, open_bus
from rs485bus.bus.owner import Owner
from rs485bus.sim import SimUnit, VirtualLine
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding
from rs485bus.wire.timing import LineSettings
from tests.integration.support import virtual


@pytest.mark.parametrize(("silence", "kept"), [(None, 0.001_75), (0.000_5, 0.000_5), (0.003, 0.003)])
def test_between_two_frames_there_is_the_silence_asked_for(silence: float | None, kept: float) -> None:
    rig = Rig(SimUnit(1, {0: 7}), config=BusConfig(echo=False, silence=silence))
    rig.pair.lenient = True
    for _ in range(3):
        rig.submit(read_holding(1, 0, 1))
    rig.run(1.0)
    line = LineSettings(baudrate=115200)
    takes = line.airtime(8) + 0.002 + line.airtime(7)
    gaps = [after - before - takes for (before, _), (after, _) in zip(rig.sent, rig.sent[1:], strict=False)]
    assert gaps == pytest.approx([kept] * 2, abs=1e-6)


@pytest.mark.parametrize(
    ("tcp_gap", "baudrate", "kept"), [(None, 115200, 0.001_75), (None, 2400, 0.016), (0.1, 2400, 0.1)]
)
def test_a_gateway_that_hands_bytes_on_at_once_keeps_the_silence_of_its_pair(
    tcp_gap: float | None, baudrate: int, kept: float
) -> None:
    line = LineSettings(baudrate=baudrate)
    rig = Rig(SimUnit(1, {0: 7}), line=line, config=BusConfig(echo=False, tcp_gap=tcp_gap), gateway=True)
    for _ in range(3):
        rig.submit(read_holding(1, 0, 1))
    rig.run(1.0)
    records = list(rig.owner.journal.flight)
    gaps = [after.sent_at - before.ended_at for before, after in itertools.pairwise(records)]
    assert gaps == pytest.approx([kept] * 2, rel=0.01)


def test_it_is_never_less_than_one_and_a_half_characters() -> None:
    line = LineSettings(baudrate=115200)
    shortest = 1.5 * 11 / 115200
    assert Owner(line, BusConfig(silence=1.01 * shortest), 0.0).pair.silence == 1.01 * shortest
    with pytest.raises(ValueError, match=r"less than 1\.5 characters at 115200 bit/s \(0\.000143 s\)"):
        Owner(line, BusConfig(silence=0.99 * shortest), 0.0)


def test_the_log_and_the_statistics_say_so(caplog: pytest.LogCaptureFixture) -> None:
    @virtual
    async def main() -> None:
        line = VirtualLine(SimUnit(1, {0: 7}))
        async with open_bus(line) as bus:
            assert bus.stats.silence == 0.001_75
        assert caplog.records == []
        line.pair.lenient = True
        async with open_bus(line, config=BusConfig(silence=0.000_5)) as bus:
            assert bus.stats.silence == 0.000_5
            assert await bus.unit(1).read_holding_registers(0) == [7]
            await asyncio.sleep(0)

    with caplog.at_level(logging.WARNING):
        main()
    said = "virtual line: 0.50 ms of silence between frames, as configured, instead of the 1.75 ms of Modbus (t3.5)"
    assert [record.getMessage() for record in caplog.records] == [said]
