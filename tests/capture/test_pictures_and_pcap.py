"""Captures as pictures, as numbers, and for Wireshark."""

import shutil
import subprocess
from pathlib import Path

import pytest

from rs485bus import blocking, open_bus
from rs485bus.bus.capture_lines import Exchange, Header, Stray
from rs485bus.capture import Capture, load, summarise, write_pcap
from rs485bus.capture.figures import save, timeline
from rs485bus.capture.traces import traces
from rs485bus.sim import SimUnit, VirtualLine
from rs485bus.wire.crc import crc
from rs485bus.wire.timing import LineSettings
from tests.capture.support import cell, work
from tests.integration.support import virtual

HEADER = Header(port="x", line=LineSettings(baudrate=115200), started="2026-05-04T10:11:12+00:00")


def frame(text: str) -> bytes:
    data = bytes.fromhex(text)
    return data + crc(data)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """A capture of a cell at work."""
    path = tmp_path_factory.mktemp("captures") / "cell.jsonl"

    @virtual
    async def record() -> None:
        await work(cell(), [], path)

    record()
    return load(path)


def test_the_axes_are_traced_in_turns_and_rpm(recorded: Capture) -> None:
    found = {trace.name: trace for trace in traces(recorded)}
    assert {"MKS 1", "ZLAC 3 left", "TL-R 4"} <= found.keys()
    assert found["MKS 1"].positions[-1].value == pytest.approx(1.5, abs=0.01)
    assert found["MKS 1"].targets[-1].value == pytest.approx(1.5)
    assert found["TL-R 4"].positions[-1].value == pytest.approx(1.0, abs=0.01)
    assert max(point.value for point in found["ZLAC 3 left"].speeds) == pytest.approx(60, abs=1)
    assert 60 in [point.value for point in found["ZLAC 3 left"].set_points]
    assert 100 < max(point.value for point in found["MKS 1"].measured_speeds) < 320


def test_numbers_add_up(recorded: Capture) -> None:
    summary = summarise(recorded)
    assert summary.units[9].refused == 1
    assert summary.units[9].requests == 21
    assert summary.units[9].replies == 20
    assert sum(summary.by_purpose.values()) == len(recorded.exchanges)
    assert 0 < summary.load <= summary.busiest <= 1
    fastest, slowest = summary.units[9].latency(0), summary.units[9].latency(1)
    assert fastest is not None
    assert slowest is not None
    assert 0.003 < fastest <= slowest < 0.006


@pytest.mark.parametrize("ending", ["svg", "png", "html"])
def test_a_capture_is_drawn(recorded: Capture, tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"cell.{ending}"
    figure = timeline(recorded, begin=0.5, end=1.5)
    assert [axes.get_ylabel() for axes in figure.axes][1:] == [
        "latency (ms)",
        "load (%)",
        "position (turns)",
        "speed (rpm)",
    ]
    save(figure, path, recorded)
    begin = path.read_bytes()[:200]
    assert begin.startswith({"svg": b"<?xml", "png": b"\x89PNG", "html": b"<!doctype html>"}[ending])


def test_what_cannot_be_drawn_is_said(recorded: Capture, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"must end in \.svg, \.png"):
        save(timeline(recorded, begin=0.5, end=0.6), tmp_path / "x.gif")
    with pytest.raises(ValueError, match="nothing to draw"):
        timeline(recorded, begin=1e6)


@virtual
async def test_a_bus_is_drawn_as_it_is() -> None:
    async with open_bus(cell()) as bus:
        await bus.unit(9).read_holding_registers(0, 2)
        assert len(timeline(bus).axes) == 3


def test_the_blocking_face_of_a_bus_is_drawn_as_well() -> None:
    with blocking.open_bus(VirtualLine(SimUnit(9, {0: 1}), baudrate=115200)) as bus:
        bus.unit(9).read_holding_registers(0, 1)
        assert len(timeline(bus).axes) == 3


def tshark(path: Path, *options: str) -> list[list[str]]:
    """What tshark makes of each packet: protocol, whether it is malformed, and the text."""
    fields = ("_ws.col.Protocol", "_ws.malformed", "_ws.col.Info", "frame.time_relative")
    command = ["tshark", "-r", str(path), "-T", "fields", *(f"-e{field}" for field in fields), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return [line.split("\t") for line in done.stdout.splitlines()]


@pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is missing: sudo apt-get install tshark")
def test_tshark_dissects_every_frame_and_finds_none_malformed(recorded: Capture, tmp_path: Path) -> None:
    odd = [
        Exchange(90.0, 90.1, 1, frame("01 10 0090 0003 05 0001000064"), frame("01 10 0090 0003"), "reply"),
        Exchange(91.0, 91.1, 0, frame("00 06 00F7 0001"), b"", "broadcast"),
        Exchange(92.0, 92.1, 9, frame("09 07"), frame("09 07 05"), "reply"),
        Exchange(93.0, 93.1, 9, frame("09 17 0000 0002 0003 0001 02 0009"), frame("09 17 04 00010002"), "reply"),
        Exchange(94.0, 94.1, 5, b"", frame("05 04 02 0001"), "unasked"),
    ]
    whole = Capture(
        recorded.header, [*recorded.exchanges, *odd], [Stray(95.0, 95.1, b"\x00\xff\x13")], recorded.families
    )
    path = tmp_path / "cell.pcap"
    count = write_pcap(whole, path)
    packets = tshark(path, "-o", "mbrtu.tcp.port:502")
    assert len(packets) == count == sum(bool(each.request) + bool(each.reply) for each in whole.exchanges) + 1
    assert {packet[0] for packet in packets} == {"Modbus RTU"}
    assert not any(packet[1] for packet in packets)
    text = [packet[2] for packet in packets]
    assert not any("Unable to classify" in each for each in text)
    assert sum("Query" in each for each in text) == sum(bool(each.request) for each in whole.exchanges) - 3
    # What the dissector does not take is said in words, which Wireshark shows from 4.2 on.
    assert b"write homing parameters" in path.read_bytes()
    assert b"3 bytes that are no frame" in path.read_bytes()
    assert float(packets[-1][3]) == pytest.approx(95.1 - (recorded.exchanges[0].at + 8 * 10 / 115200), abs=1e-4)
