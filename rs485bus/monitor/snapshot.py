"""What the monitor shows at one moment. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from rs485bus.bus.capture_lines import Exchange, Header, exchange_of
from rs485bus.bus.record import Record
from rs485bus.capture.explanation import values_of
from rs485bus.capture.pdu import spoken
from rs485bus.capture.reading import Capture
from rs485bus.capture.traces import Trace, traces
from rs485bus.devices.mks import registers as mks
from rs485bus.devices.tlr import registers as tlr
from rs485bus.devices.zlac import registers as zlac
from rs485bus.wire.timing import LineSettings

_SECOND = 1.0
_TOO_SOON = 0.005
"""Seconds between two positions that tell no speed."""
_OLD = 1.0
"""Seconds between two positions that tell nothing of the speed now."""
_SHOWN = 60
"""Transactions kept to be shown."""
_SILENT = 3
"""Unanswered requests in a row after which a drive is called silent."""
_MEMORABLE = 2000
_RESOLUTIONS = {
    *(mks.MICROSTEPS.name, tlr.SUBDIVISION.name, zlac.SPEED_RESOLUTION.name),
    *(register.name for register in (zlac.ENCODER_LINES.left, zlac.ENCODER_LINES.right)),
}
"""Registers that say how counts are to be read."""
_WATCHDOGS = {"MKS": mks.WATCHDOG.name, "ZLAC": zlac.WATCHDOG.name}
"""The registers of the families that hold the watchdog's time, in milliseconds."""


class AxisSight(NamedTuple):
    """One axis. None stands for what is not known."""

    name: str
    state: str
    position: float | None
    unit: str
    target: float | None
    rpm: float | None
    set_point: float | None
    margin: float | None
    """Seconds until its drive's watchdog trips unless the drive is heard; None where none is armed."""
    watchdog: float | None
    """The time of that watchdog, in seconds."""
    notice: str
    """What is wrong with it, or what was just done to it."""


class BusSight(NamedTuple):
    """One pair."""

    name: str
    port: str
    baudrate: int
    connected: bool
    load: float
    """The share of the last second in which bytes were on the pair."""
    rate: int
    """Requests in the last second."""
    unanswered: int
    refused: int
    """Since it was opened."""
    lost: float
    """The share of the requests that were not answered, since it was opened."""
    latency: float | None
    """Seconds; the median of the last second's replies."""
    latest: tuple[Exchange, ...]
    """The latest exchanges, the oldest first."""
    families: Mapping[int, str]


class Place(NamedTuple):
    """Where an axis was last seen, and how fast it turned."""

    at: float
    position: float | None
    rpm: float | None

    def speed(self, at: float, position: float | None, units_per_turn: float) -> float | None:
        """How fast it turns, by how far it has come: what a drive said of its speed may have been said long ago."""
        if position is None or self.position is None or at - self.at > _OLD:
            return None
        if at - self.at < _TOO_SOON:
            return self.rpm
        return 60 * (position - self.position) / units_per_turn / (at - self.at)


NOWHERE = Place(float("-inf"), None, None)


def state_of(
    *,
    connected: bool,
    silent: bool,
    latched: bool,
    wrong: str,
    known: bool,
    moving: bool | None,
    rpm: float | None,
    enabled: bool | None,
) -> str:
    """What an axis does, in one word."""
    if not connected:
        return "NO PORT"
    if silent:
        return "SILENT"
    if latched:
        return "E-STOP"
    if wrong:
        return "FAULT"
    if not known:
        return "unknown"
    if moving or (moving is None and abs(rpm or 0.0) >= 1.0):
        return "moving"
    return "released" if enabled is False else "stands"


class Snapshot(NamedTuple):
    """Everything."""

    at: float
    axes: tuple[AxisSight, ...]
    buses: tuple[BusSight, ...]


@dataclass(slots=True)
class DriveLedger:
    """What its frames told of one drive."""

    heard_at: float | None = None
    """When the last request was sent that it answered."""
    misses: int = 0
    """Unanswered requests in a row."""
    watchdog: float = 0.0
    """The time that its watchdog is set to, in seconds; 0 for off."""

    def margin(self, now: float) -> float | None:
        """Seconds until it trips; None where its watchdog is off."""
        if not self.watchdog or self.heard_at is None:
            return None
        return self.watchdog - (now - self.heard_at)


class BusLedger:
    """Adds up what a bus tells of itself.

    Args:
        line: how characters travel on it.
    """

    def __init__(self, line: LineSettings) -> None:
        self.line = line
        self.drives: dict[int, DriveLedger] = {}
        self.families: dict[int, str] = {}
        self.latest: deque[Exchange] = deque(maxlen=_SHOWN)
        self._second: deque[tuple[float, float, float | None]] = deque()
        """When each exchange of the last second ended, its airtime, and its latency if it was answered."""
        self._memorable: dict[tuple[int, int, int, int], Exchange] = {}
        """The latest exchange of each kind that told a drive something, or how its counts are to be read."""
        self.requests = self.unanswered = self.refused = 0

    def add(self, record: Record) -> None:
        """The bus has carried out an exchange."""
        self.take(exchange_of(record, 0.0))

    def take(self, exchange: Exchange) -> None:
        """The same of an exchange that was told elsewhere. Its times are those of whoever asks."""
        self.latest.append(exchange)
        answered = exchange.outcome == "reply"
        airtime = self.line.airtime(len(exchange.request) + len(exchange.reply))
        self._second.append((exchange.ended, airtime, exchange.latency if answered else None))
        self.requests += 1
        self.unanswered += exchange.outcome in ("no reply", "lost", "cut")
        self.refused += exchange.outcome == "refused"
        drive = self.drives.setdefault(exchange.address, DriveLedger())
        if exchange.reply:
            drive.heard_at, drive.misses = exchange.at, 0
        elif exchange.outcome in ("no reply", "lost"):
            drive.misses += 1
        family = self.families.get(exchange.address)
        if family is not None and answered:
            self._learn(drive, exchange, family)

    def _learn(self, drive: DriveLedger, exchange: Exchange, family: str) -> None:
        values = {value.name: value.value for value in values_of(exchange, family) if value.value is not None}
        milliseconds = values.get(_WATCHDOGS.get(family, ""))
        if milliseconds is not None:
            drive.watchdog = milliseconds / 1000
        asked = spoken(exchange.request)
        if (asked.verb == "write" or not _RESOLUTIONS.isdisjoint(values)) and len(self._memorable) < _MEMORABLE:
            self._memorable[exchange.address, asked.function, asked.register, asked.count] = exchange

    def told(self) -> list[Trace]:
        """What the drives were told last."""
        header = Header(port="", line=self.line, started="")
        latest = sorted(self._memorable.values(), key=lambda exchange: exchange.at)
        return traces(Capture(header, latest, families=self.families))

    def _last_second(self, now: float) -> tuple[float, int, float | None]:
        """The load, the requests, and the median latency of the last second."""
        while self._second and self._second[0][0] < now - _SECOND:
            self._second.popleft()
        latencies = sorted(latency for _, _, latency in self._second if latency is not None)
        median = latencies[len(latencies) // 2] if latencies else None
        return min(1.0, sum(airtime for _, airtime, _ in self._second) / _SECOND), len(self._second), median

    def sight(self, name: str, port: str, *, connected: bool, now: float) -> BusSight:
        """What there is to see of it.

        Args:
            name: what it is called.
            port: its port, for people.
            connected: its port is there.
            now: the time, by the clock of its exchanges.
        """
        load, rate, latency = self._last_second(now)
        return BusSight(
            name=name,
            port=port,
            baudrate=self.line.baudrate,
            connected=connected,
            load=load,
            rate=rate,
            unanswered=self.unanswered,
            refused=self.refused,
            lost=self.unanswered / self.requests if self.requests else 0.0,
            latency=latency,
            latest=tuple(self.latest),
            families=dict(self.families),
        )

    def is_silent(self, address: int) -> bool:
        """Whether a drive has stopped answering."""
        return self.drives.get(address, DriveLedger()).misses >= _SILENT
