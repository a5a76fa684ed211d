"""`rs485bus sniff`: listens to a pair that another master owns, and sends nothing."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from contextlib import AsyncExitStack
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console

from rs485bus.bus.capture_lines import Entry, Header
from rs485bus.bus.config import BusConfig
from rs485bus.bus.port_urls import transport_at
from rs485bus.bus.recording import KEEP, Recording
from rs485bus.capture.reading import Capture
from rs485bus.capture.sniffer import Sniffer
from rs485bus.capture.statistics import summarise
from rs485bus.cli.session import Where, open_plant
from rs485bus.cli.telling import Teller, print_json, summary_json
from rs485bus.cli.virtual import BAUDRATE
from rs485bus.cli.watch import to_and_fro
from rs485bus.errors import PortError
from rs485bus.sim import VirtualLine
from rs485bus.transport.alarm import Alarm, make_alarm
from rs485bus.transport.interface import Sink, Transport
from rs485bus.wire.timing import LineSettings, Parity

_HINT_AFTER = 5.0
"""Seconds after which it is said why nothing may be heard."""
_TICK = 0.02
_NAMES = {"MKS": "mks", "ZLAC": "zlac", "TL-R": "tlr"}
"""How plants call the families."""
_KEPT = 200_000
"""Exchanges that the statistics at the end are made of: the latest."""


class _Ear:
    """Takes what a transport receives."""

    def __init__(self, hear: Callable[[bytes], None]) -> None:
        self._hear = hear
        self.gone: asyncio.Future[Exception | None] = asyncio.get_running_loop().create_future()

    def received(self, data: bytes) -> None:
        self._hear(data)

    def lost(self, error: Exception | None) -> None:
        if not self.gone.done():
            self.gone.set_result(error)


class Listening:
    """A pair that is listened to. Made anew for each run.

    Args:
        transport: the way to it; nothing is ever written to it.
        drives: of which families some are known to be, by address.
    """

    def __init__(self, transport: Transport, drives: dict[int, str]) -> None:
        self._transport = transport
        self._loop = asyncio.get_running_loop()
        self._since = self._loop.time()
        header = Header(port=transport.name, line=transport.line, started=datetime.now(UTC).isoformat(), by="sniffer")
        self.capture = Capture(header, families=drives)
        self._sniffer = Sniffer(transport.line, self._tell)
        self._sniffer.families |= drives
        self._teller: Teller | None = None
        self._recording: Recording | None = None

    def show(self, teller: Teller) -> None:
        """Tell what is heard while it is heard."""
        self._teller = teller

    def record(self, path: Path, max_bytes: int, keep: int) -> Recording:
        """Write what is heard to a capture file. Raises as `Recording`."""
        self._recording = Recording(path, self.capture.header, max_bytes=max_bytes, keep=keep)
        return self._recording

    async def listen(self, seconds: float | None) -> None:
        """Listen, for so long or until it is cancelled.

        Raises:
            PortError: the port cannot be opened, or was lost.
        """
        ear = _Ear(self._hear)
        await self._transport.open(ear)
        self._since = self._loop.time()
        ends = float("inf") if seconds is None else self._since + seconds
        hint = self._since + _HINT_AFTER
        try:
            while self._loop.time() < ends:
                await asyncio.wait([ear.gone], timeout=min(_TICK, ends - self._loop.time()))
                if ear.gone.done():
                    raise PortError(f"{self._transport.name} was lost: {ear.gone.result() or 'it was closed'}")
                self._sniffer.tick(self._now())
                if self._loop.time() >= hint:
                    hint = float("inf")
                    self._say_what_is_wrong()
        finally:
            self._sniffer.end(self._now())
            if self._recording is not None:
                self._recording.close()
            await self._transport.close()

    def _now(self) -> float:
        return self._loop.time() - self._since

    def _hear(self, data: bytes) -> None:
        self._sniffer.feed(data, self._now())

    def _tell(self, entry: Entry) -> None:
        self.capture.add(entry)
        if len(self.capture.exchanges) > _KEPT:
            del self.capture.exchanges[: _KEPT // 10]
        if self._recording is not None:
            self._recording.put(entry)
        if self._teller is not None:
            self._teller.tell(entry)

    def _say_what_is_wrong(self) -> None:
        sniffer, line = self._sniffer, self._transport.line
        if not sniffer.bytes:
            said = (
                f"Nothing was heard on {self._transport.name} for {_HINT_AFTER:g} s. Is the other master running? Are "
                "A, B and ground connected? Listening goes on."
            )
        elif not sniffer.frames:
            said = (
                f"{sniffer.bytes} bytes were heard, and no frame among them: the baud rate is not {line.baudrate}, "
                f"the parity is not {line.parity}, A and B are swapped, or the pair speaks no Modbus RTU. Listening "
                "goes on."
            )
        else:
            return
        print(said, file=sys.stderr, flush=True)


class VirtualPair:
    """Virtual drives that move to and fro, as a pair to listen to.

    Args:
        where: which ones.
    """

    name = "virtual line"
    gateway = False
    unsent = 0

    def __init__(self, where: Where) -> None:
        self.line = LineSettings(baudrate=BAUDRATE)
        self._where = where
        self._open = AsyncExitStack()

    async def open(self, sink: Sink) -> None:
        plant = await self._open.enter_async_context(open_plant(self._where, tells=False))
        (line,) = plant.lines.values()
        assert isinstance(line, VirtualLine)
        self._open.callback(line.listen(lambda data, _: sink.received(data)))
        await self._open.enter_async_context(to_and_fro(plant))

    async def close(self) -> None:
        await self._open.aclose()

    def write(self, data: bytes) -> None:
        """Nothing is ever sent."""

    def abort(self) -> None:
        """There is nothing to give up."""

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        return make_alarm(asyncio.get_running_loop(), callback)


async def sniff(
    port: str | None,
    baudrate: int,
    parity: Parity,
    stopbits: int,
    console: Console,
    *,
    record: Path | None,
    max_bytes: int,
    keep: int = KEEP,
    seconds: float | None,
    hexadecimal: bool,
    errors_only: bool,
    quiet: bool,
    json: bool,
    drives: dict[int, str],
) -> int:
    """Listen to a pair, and tell what is heard. Without a port there are virtual drives. Returns the exit code."""
    listening = Listening(_transport(port, baudrate, parity, stopbits, drives), drives if port else {})
    capture = listening.capture
    teller = Teller(console, capture.families, hexadecimal=hexadecimal, errors_only=errors_only)
    if not (quiet or json):
        listening.show(teller)
    if record is not None:
        listening.record(record, max_bytes, keep)
    try:
        await listening.listen(seconds)
    finally:
        summary = summarise(capture)
        if json:
            print_json(summary_json(summary, capture.families))
        elif capture.exchanges or capture.strays:
            teller.summary(summary)
        if record is not None:
            console.print(f"Recorded to {record}.", markup=False, soft_wrap=True)
    return 0


def _transport(port: str | None, baudrate: int, parity: Parity, stopbits: int, drives: dict[int, str]) -> Transport:
    """The way to a pair; to a virtual one where no port is named."""
    if port is None:
        named: dict[str, list[int]] = {}
        for address, family in drives.items():
            named.setdefault(_NAMES[family], []).append(address)
        return VirtualPair(Where(drives=named, sim=True))
    return transport_at(
        port,
        baudrate=baudrate,
        parity=parity,
        stopbits=2 if stopbits == 2 else 1,
        backend=None,
        native=False,
        config=BusConfig(),
    )()
