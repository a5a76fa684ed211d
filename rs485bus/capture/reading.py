"""Reads capture files, and makes captures of what a bus remembers."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Protocol

from rs485bus.bus.bus import Bus
from rs485bus.bus.capture_lines import (
    Drive,
    Dropped,
    Entry,
    Exchange,
    Header,
    Stray,
    exchange_of,
    read_entry,
    read_header,
)
from rs485bus.bus.record import Record
from rs485bus.capture.pdu import spoken
from rs485bus.capture.vocabulary import VOCABULARIES, family_of
from rs485bus.wire.timing import LineSettings

_TOLD = 5
"""Broken lines that are told one by one."""


@dataclass(slots=True)
class Capture:
    """What happened on a pair."""

    header: Header
    exchanges: list[Exchange] = field(default_factory=list)
    """In the order in which they ended."""
    strays: list[Stray] = field(default_factory=list)
    families: dict[int, str] = field(default_factory=dict)
    """The families of the drives that are known, by address."""
    dropped: int = 0
    """Records that were lost because the disk was too slow."""
    faults: list[str] = field(default_factory=list)
    """Lines that could not be read, in words."""

    def add(self, entry: Entry) -> None:
        """Take an entry in."""
        if isinstance(entry, Exchange):
            self.exchanges.append(entry)
        elif isinstance(entry, Stray):
            self.strays.append(entry)
        elif isinstance(entry, Drive):
            self.families[entry.address] = entry.family
        else:
            assert isinstance(entry, Dropped)
            self.dropped += entry.lost

    @property
    def span(self) -> tuple[float, float]:
        """When it begins and ends, in seconds since the capture began."""
        entries: list[Exchange | Stray] = [*self.exchanges, *self.strays]
        return min((each.at for each in entries), default=0.0), max((each.ended for each in entries), default=0.0)

    def between(self, begin: float | None, end: float | None) -> Capture:
        """The part between two times, in seconds since the capture began; None for no bound."""
        low, high = float("-inf") if begin is None else begin, float("inf") if end is None else end
        return Capture(
            self.header,
            [each for each in self.exchanges if each.ended >= low and each.at <= high],
            [each for each in self.strays if each.ended >= low and each.at <= high],
            self.families,
            self.dropped,
            self.faults,
        )

    def recognise(self) -> None:
        """Find out the families of drives that nobody named, by what they have answered."""
        answered: dict[int, set[bytes]] = {}
        for exchange in self.exchanges:
            if exchange.outcome == "reply" and len(exchange.request) >= 4:
                answered.setdefault(exchange.address, set()).add(exchange.request)
        for address, requests in answered.items():
            if address not in self.families and (family := family_of(map(spoken, requests))):
                self.families[address] = family


def load(*paths: str | os.PathLike[str]) -> Capture:
    """Read a capture; of one in several files all of them, in any order.

    Lines that are broken are left out, and told in `faults`: the last one is where a program was killed.

    Raises:
        ValueError: a file is no capture, is of a newer version, or belongs to another capture than the others.
        OSError: a file cannot be read.
    """
    parts = sorted((_load(Path(path)) for path in paths), key=lambda part: part.span)
    whole = parts[0]
    for part in parts[1:]:
        if part.header.started != whole.header.started:
            raise ValueError(
                f"the files are of captures that began at {whole.header.started} and at {part.header.started}: "
                "give those of one capture"
            )
        whole.exchanges += part.exchanges
        whole.strays += part.strays
        whole.families |= part.families
        whole.dropped += part.dropped
        whole.faults += part.faults
    whole.recognise()
    return whole


class Remembers(Protocol):
    """A bus, or the blocking face of one."""

    @property
    def port(self) -> str: ...

    @property
    def line(self) -> LineSettings: ...

    @property
    def flight(self) -> list[Record]: ...


def capture_of(bus: Remembers) -> Capture:
    """What a bus remembers: its latest 256 transactions. The first is taken for the begin, and the last for now."""
    records = bus.flight
    since, until = (records[0].sent_at, records[-1].ended_at) if records else (0.0, 0.0)
    started = datetime.now(UTC) - timedelta(seconds=until - since)
    capture = Capture(Header(port=bus.port, line=bus.line, started=started.isoformat()))
    capture.exchanges = [exchange_of(record, since) for record in records]
    if isinstance(bus, Bus):
        capture.families = {device.address: device.family for device in bus.devices}
    capture.recognise()
    return capture


def name_drives(capture: Capture, named: Iterable[tuple[str, Sequence[int]]]) -> None:
    """Say of which families drives are: each family's name with addresses.

    Raises:
        ValueError: nobody knows a family of that name.
    """
    for family, addresses in named:
        if family not in VOCABULARIES:
            raise ValueError(f"{family!r} is none of the families {', '.join(VOCABULARIES)}")
        capture.families |= dict.fromkeys(addresses, family)


def _load(path: Path) -> Capture:
    with open(path, encoding="utf-8", errors="replace") as file:
        try:
            capture = Capture(read_header(file.readline()))
        except ValueError as error:
            raise ValueError(
                f"{path} is no capture: {error}. Captures are made by `rs485bus record`, `rs485bus sniff` and "
                "bus.record_to()"
            ) from None
        broken = 0
        for number, line in enumerate(file, start=2):
            if not line.strip():
                continue
            try:
                entry = read_entry(line)
            except ValueError as error:
                broken += 1
                if broken <= _TOLD:
                    end = "" if line.endswith("\n") else " It is the last one: the program was ended while it wrote."
                    capture.faults.append(f"{path}, line {number} was left out: {error}.{end}")
                continue
            if entry is not None:
                capture.add(entry)
        if broken > _TOLD:
            capture.faults.append(f"{path}: {broken - _TOLD} more lines were left out")
    return capture
