"""Capture files: written while a bus goes on, in several files, and read again."""

import json
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus import open_bus
from rs485bus.bus.capture_lines import (
    Drive,
    Dropped,
    Entry,
    Exchange,
    Header,
    Stray,
    entry_line,
    exchange_of,
    header_line,
    read_entry,
    read_header,
)
from rs485bus.bus.record import Record
from rs485bus.bus.recording import Recording
from rs485bus.capture import capture_of, load, words_of
from rs485bus.errors import LimitExceeded
from rs485bus.wire.timing import LineSettings
from tests.capture.support import cell, work
from tests.integration.support import virtual

HEADER = Header(port="/dev/ttyX", line=LineSettings(baudrate=19200, parity="E"), started="2026-05-04T10:11:12+00:00")
FRAME = bytes.fromhex("010400310003e1c4")

times = st.integers(-10_000_000, 10_000_000).map(lambda microseconds: microseconds / 1e6)
exchanges = st.builds(
    Exchange,
    times,
    times,
    st.integers(0, 255),
    st.binary(max_size=20),
    st.binary(max_size=20),
    st.sampled_from(["reply", "refused", "no reply", "cut", "lost", "broadcast", "sent", "unasked"]),
    st.sampled_from(["", "stop", "poll"]),
    st.integers(1, 9),
    st.none() | times,
    st.none() | times,
    st.integers(0, 300),
)
entries = (
    exchanges
    | st.builds(Stray, times, times, st.binary(max_size=9))
    | st.builds(Drive, st.integers(1, 255), st.sampled_from(["MKS", "ZLAC"]))
    | st.builds(Dropped, times, st.integers(1, 99))
)


@given(entries)
def test_every_entry_is_read_as_it_was_written(entry: Entry) -> None:
    line = entry_line(entry)
    assert line.endswith("\n")
    assert "\n" not in line[:-1]
    assert read_entry(line) == entry


@given(
    st.dictionaries(
        st.sampled_from(["at", "ended", "unit", "family", "stray", "dropped", "outcome", "request", "reply", "first"]),
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6) | st.lists(st.integers()),
    )
)
def test_whatever_stands_in_a_line_it_is_an_entry_or_a_value_error(told: dict[str, object]) -> None:
    try:
        entry = read_entry(json.dumps(told))
    except ValueError:
        return
    if isinstance(entry, Exchange):
        assert words_of(entry, "MKS").asked


def test_a_header_is_read_as_it_was_written() -> None:
    assert read_header(header_line(HEADER)) == HEADER


def test_a_kind_of_line_that_is_not_known_is_passed_over() -> None:
    assert read_entry('{"temperature": 20, "at": 1}') is None


@pytest.mark.parametrize("line", ["", "[]", "{", '{"outcome": "reply"}', '{"family": "MKS", "unit": "x"}'])
def test_a_broken_line_is_a_value_error(line: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        read_entry(line)


@virtual
async def test_record_to_writes_what_the_bus_tells_its_observers(tmp_path: Path) -> None:
    path = tmp_path / "cell.jsonl"
    records: list[Record] = []
    await work(cell(), records, path)
    capture = load(path)
    assert capture.faults == []
    assert capture.families == {1: "MKS", 3: "ZLAC", 4: "TL-R"}
    assert capture.header.line == cell().line
    written = [(each.request, each.reply, each.outcome, each.urgency, each.attempt) for each in capture.exchanges]
    told = [(each.request, each.reply, each.outcome, each.urgency.name.lower(), each.attempt) for each in records]
    assert written == told[: len(written)]
    assert len(told) - len(written) <= 10  # what came after it was closed
    since = records[0].sent_at - capture.exchanges[0].at
    assert all(
        abs(each.at - record.sent_at + since) < 2e-6 for each, record in zip(capture.exchanges, records, strict=False)
    )


@virtual
async def test_closing_the_bus_ends_the_recording(tmp_path: Path) -> None:
    async with open_bus(cell()) as bus:
        recording = bus.record_to(tmp_path / "cell.jsonl")
        await bus.unit(9).read_holding_registers(0, 2)
    assert not any("cell.jsonl" in thread.name for thread in threading.enumerate())
    assert len(load(tmp_path / "cell.jsonl").exchanges) == recording.count == 1
    recording.close()


def test_a_file_that_has_grown_becomes_an_older_one_and_each_can_be_read_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    with Recording(path, HEADER, max_bytes=10_000, keep=2) as recording:
        recording.put(Drive(1, "MKS"))
        for at in range(500):
            recording.put(Exchange(at, at + 0.5, 1, FRAME, b"", "no reply"))
    names = sorted(each.name for each in tmp_path.iterdir())
    assert names == ["a.jsonl", "a.jsonl.1", "a.jsonl.2"]
    parts = [load(tmp_path / name) for name in names]
    assert all(part.families == {1: "MKS"} and part.header == HEADER for part in parts)
    assert all((tmp_path / name).stat().st_size < 10_300 for name in names)
    whole = load(*(tmp_path / name for name in names))
    numbers = [each.at for each in whole.exchanges]
    assert numbers == sorted(numbers)
    assert numbers[-1] == 499


def test_a_capture_that_is_there_is_kept_and_another_file_is_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    for _ in range(2):
        Recording(path, HEADER).close()
    assert (tmp_path / "a.jsonl.1").exists()
    plant = tmp_path / "plant.toml"
    plant.write_text('name = "cell"\n')
    with pytest.raises(ValueError, match="is no capture: name another file"):
        Recording(plant, HEADER)
    assert plant.read_text() == 'name = "cell"\n'
    with pytest.raises(LimitExceeded, match="max_bytes"):
        Recording(tmp_path / "b.jsonl", HEADER, max_bytes=1)


def test_a_disk_that_is_full_ends_the_recording_and_not_the_bus(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    recording = Recording(tmp_path / "a.jsonl", HEADER)

    class Full:
        def write(self, text: str) -> int:
            raise OSError(28, "No space left on device")

        def close(self) -> None: ...

    recording._file.close()
    recording._file = Full()  # type: ignore[assignment]
    for at in range(3):
        recording.put(Exchange(at, at, 1, FRAME, b"", "no reply"))
    recording.close()
    assert "No space left" in str(recording.error)
    assert caplog.text.count("nothing is recorded any more") == 1


def test_files_of_two_captures_are_not_mixed(tmp_path: Path) -> None:
    for name, started in (("a", "2026-01-01T00:00:00+00:00"), ("b", "2026-01-02T00:00:00+00:00")):
        Recording(tmp_path / name, Header(port="x", line=HEADER.line, started=started)).close()
    with pytest.raises(ValueError, match="give those of one capture"):
        load(tmp_path / "a", tmp_path / "b")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no JSON"),
        ("hello\n", "no JSON"),
        ('{"a": 1}\n', "does not begin with"),
        (json.dumps({"capture": "rs485bus", "version": 2}) + "\n", "update rs485bus"),
        (json.dumps({"capture": "rs485bus", "version": 1}) + "\n", "says no port"),
        (json.dumps({**json.loads(header_line(HEADER)), "baudrate": "fast"}) + "\n", "baudrate must be a whole number"),
        (json.dumps({**json.loads(header_line(HEADER)), "started": "noon"}) + "\n", "header is wrong"),
    ],
)
def test_what_is_no_capture_is_said_to_be_none(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "x"
    path.write_text(text)
    with pytest.raises(ValueError, match=said) as error:
        load(path)
    assert "rs485bus record" in str(error.value)


def test_broken_lines_are_left_out_and_told(tmp_path: Path) -> None:
    path = tmp_path / "x"
    good = entry_line(Exchange(1.0, 1.1, 1, FRAME, b"", "no reply"))
    path.write_text(header_line(HEADER) + good + "rubbish\n" + good + '{"at": 2.0, "un')
    capture = load(path)
    assert len(capture.exchanges) == 2
    assert "line 3 was left out" in capture.faults[0]
    assert "the program was ended while it wrote" in capture.faults[1]


@virtual
async def test_a_capture_is_made_of_what_a_bus_remembers() -> None:
    async with open_bus(cell()) as bus:
        for _ in range(3):
            await bus.unit(9).read_holding_registers(0, 2)
        capture = capture_of(bus)
        assert [each.request for each in capture.exchanges] == [record.request for record in bus.flight]
        assert capture.exchanges[0] == exchange_of(bus.flight[0], bus.flight[0].sent_at)
