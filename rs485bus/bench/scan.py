"""Finding what hangs on a pair: at which addresses, rates and formats somebody answers, and which family it is of.

Only reads are sent. Each address is asked by function 04, which MKS drives read by, and if it is silent by function 03;
a device that knows a function but not the register refuses, and has answered, too. The first round waits for an answer
as long as drives usually need. What is heard later than that, or garbled, has the addresses asked again with patience.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.opening import Opening, open_bus
from rs485bus.errors import DeviceOffline, DeviceRefused, NoReply, PortError
from rs485bus.plant.families import families
from rs485bus.plant.family import Family, Sign
from rs485bus.transport.interface import Transport
from rs485bus.wire.timing import LineSettings, Parity

PortOf = str | Callable[[LineSettings], str | Transport]
"""A port, as for `open_bus`; or what makes one for some line settings."""

RATES = (38400, 115200, 9600, 19200, 57600, 256000, 128000)
"""bit/s, in the order in which they are tried: first those at which drives are shipped."""
ADDRESSES = range(1, 248)
_SHIPPED = 8
"""New drives have addresses up to here."""
_QUICK = 0.010
"""Seconds after which an answer has usually begun."""
_FEW, _FEW_WAIT = 32, 0.03
"""So few addresses can be waited for longer."""
_PATIENT = 0.1
_LOOKS_BACK = 0.1
"""Seconds within which somebody was asked whose late answer may have met the next question."""
_NOISY = 20
"""Times that something was heard of which no answer could be made; from then on it is taken for noise."""
_AGREES = 4
"""Times that a drive is asked for what two at one address would answer differently."""
_SOME_SECONDS = 1.0


def port_for(port: PortOf, line: LineSettings) -> str | Transport:
    """What `open_bus` is given for some line settings."""
    return port if isinstance(port, str) else port(line)


def open_line(port: PortOf, line: LineSettings, config: BusConfig) -> Opening:
    """A bus on a port that is set to some line settings."""
    return open_bus(
        port_for(port, line), baudrate=line.baudrate, parity=line.parity, stopbits=line.stopbits, config=config
    )


class Format(NamedTuple):
    """How characters are made: "8N1"."""

    parity: Parity
    stopbits: Literal[1, 2]

    def __str__(self) -> str:
        return f"8{self.parity}{self.stopbits}"

    @classmethod
    def parse(cls, text: str) -> Format:
        """Read "8N1", "8E1", "8O1" or "8N2".

        Raises:
            ValueError: it is none.
        """
        match text.strip().upper():
            case "8N1":
                return cls("N", 1)
            case "8E1":
                return cls("E", 1)
            case "8O1":
                return cls("O", 1)
            case "8N2":
                return cls("N", 2)
        raise ValueError(f"format {text!r} is none of 8N1, 8E1, 8O1, 8N2")


@dataclass(slots=True, kw_only=True)
class Found:
    """Somebody who answers."""

    address: int
    family: str | None
    """As in plant files; None where it is of none that is known."""
    title: str
    baudrate: int
    format: Format
    version: str | None = None
    reply_ms: float | None = None
    """Milliseconds before its answer begins, the longest of some."""
    twins: bool = False
    """Its answers are garbled or change: two drives may have this address."""
    note: str = ""

    def as_json(self) -> dict[str, object]:
        """For programs."""
        return {
            "address": self.address,
            "family": self.family,
            "title": self.title,
            "baudrate": self.baudrate,
            "parity": self.format.parity,
            "stopbits": self.format.stopbits,
            "format": str(self.format),
            "version": self.version,
            "reply_ms": self.reply_ms,
            "twins": self.twins,
            "note": self.note,
        }


@dataclass(slots=True)
class Progress:
    """How far a scan is."""

    total: int
    """Questions in all."""
    done: int = 0
    line: str = ""
    """What is tried now: "38400 bit/s, 8N1"."""
    address: int = 0
    seconds: float = 0.0
    """Since the begin."""
    found: list[Found] = field(default_factory=list)

    @property
    def left(self) -> float | None:
        """Seconds that it will take from now on; None while that is not known."""
        if self.seconds < _SOME_SECONDS or not self.done:
            return None
        return self.seconds / self.done * (self.total - self.done)


@dataclass(slots=True, kw_only=True)
class Scan:
    """What to try, and what has been found so far."""

    port: PortOf
    baudrates: Sequence[int] = RATES
    formats: Sequence[Format] = (Format("N", 1),)
    addresses: Sequence[int] = ADDRESSES
    expect: int | None = None
    """Stop as soon as so many are found; None to try everything."""
    tell: Callable[[Progress], None] = lambda progress: None
    found: list[Found] = field(default_factory=list)
    noise: int = 0
    """Bytes heard that belonged to no answer."""
    skipped: list[str] = field(default_factory=list)
    """Line settings that the port does not do, and why."""

    async def run(self) -> list[Found]:
        """Try everything, or until enough is found. `found` holds what there is if it is cancelled.

        Raises:
            PortError: the port cannot be opened at any of the settings.
        """
        lines = [(rate, form) for rate in self.baudrates for form in self.formats]
        progress = Progress(total=2 * len(lines) * len(self.addresses), found=self.found)
        for addresses in self._stages(len(lines)):
            for rate, form in sorted(lines, key=self._is_new):
                progress.line = f"{rate} bit/s, {form}"
                try:
                    await self._one_line(rate, form, addresses, progress)
                except PortError as error:
                    if type(error) is not PortError or len(lines) == 1:
                        raise
                    lines.remove((rate, form))
                    self.skipped.append(f"{progress.line}: {error}")
                    progress.total -= 2 * len(self.addresses)
                if self._enough:
                    return self.found
        return self.found

    def _stages(self, lines: int) -> list[Sequence[int]]:
        """What is asked at every rate before the rest is: drives as shipped are found at once."""
        first = [address for address in self.addresses if address <= _SHIPPED]
        rest = [address for address in self.addresses if address > _SHIPPED]
        return [self.addresses] if lines == 1 or not first or not rest else [first, rest]

    def _is_new(self, line: tuple[int, Format]) -> bool:
        """Whether nobody was found there yet: those go last."""
        return line not in {(one.baudrate, one.format) for one in self.found}

    @property
    def _enough(self) -> bool:
        return self.expect is not None and len(self.found) >= self.expect

    async def _one_line(self, rate: int, form: Format, addresses: Sequence[int], progress: Progress) -> None:
        settings = LineSettings(baudrate=rate, parity=form.parity, stopbits=form.stopbits)
        config = BusConfig(reply_timeout=_PATIENT, late_reply_window=_PATIENT, retries=0, offline_after=100)
        async with open_line(self.port, settings, config) as bus:
            look = _Look(bus, addresses, progress, self.tell)
            async for address, garbled in look.answering():
                found = await recognise(bus, address, settings.baudrate, form)
                found.twins = found.twins or (garbled and found.family is None)
                self.found.append(found)
                self.found.sort(key=lambda one: (one.baudrate, one.address))
                self.tell(progress)
                if self._enough:
                    break
            self.noise += sum(unit.stray_bytes for unit in bus.stats.units.values())


class _Look:
    """Asks all addresses of one line whether somebody is there."""

    def __init__(
        self, bus: Bus, addresses: Iterable[int], progress: Progress, tell: Callable[[Progress], None]
    ) -> None:
        self._bus = bus
        self._addresses = list(addresses)
        self._progress = progress
        self._tell = tell
        self._done_before, self._seconds_before = progress.done, progress.seconds
        self._began = bus.now()
        self._quick = _QUICK if len(self._addresses) > _FEW else _FEW_WAIT
        self._strays = 0
        self._mysteries = 0
        self._asked: list[tuple[float, int]] = []
        """When each address was last asked."""

    async def answering(self) -> AsyncIterator[tuple[int, bool]]:
        """The addresses at which somebody answers, and whether that was garbled."""
        there: set[int] = set()
        questions = [next(iter(signs)) for signs in (_signs_by(4), _signs_by(3)) if signs]
        for sign in questions:
            for address in self._addresses:
                self._step(address)
                if address in there:
                    continue
                heard = await self._hears(address, sign, self._quick)
                if heard is True:
                    there.add(address)
                    yield address, False
                elif heard is None:
                    for late, garbled in await self._patiently(address, sign, there):
                        there.add(late)
                        yield late, garbled
            await anyio.sleep(_PATIENT)
            if self._heard_more():
                for late, garbled in await self._patiently(self._addresses[-1], sign, there):
                    there.add(late)
                    yield late, garbled

    async def _patiently(self, address: int, sign: Sign, there: set[int]) -> list[tuple[int, bool]]:
        """Something was heard that was no answer: find those to which it belongs, and whether they are garbled."""
        if self._mysteries >= _NOISY:
            return []
        since = self._bus.now() - _LOOKS_BACK
        earlier = [other for asked, other in self._asked if asked >= since and other != address]
        late = [other for other, unit in self._bus.stats.units.items() if unit.late_replies]
        for suspects in ([address], late, reversed(earlier)):
            found = []
            for suspect in suspects:
                if suspect in there:
                    continue
                answers = [await self._hears(suspect, sign, _PATIENT) for _ in range(2)]
                if True in answers:
                    # It may not be the only one that takes so long.
                    self._quick = min(_PATIENT, max(self._quick, 1.5 * self._bus.flight[-1].latency))
                    found.append((suspect, None in answers))
                elif answers == [None, None]:
                    found.append((suspect, True))
            if found:
                return found
        self._mysteries += 1
        return []

    def _step(self, address: int) -> None:
        progress = self._progress
        progress.done += 1
        progress.address = address
        progress.seconds = self._seconds_before + self._bus.now() - self._began
        self._tell(progress)

    async def _hears(self, address: int, sign: Sign, wait: float) -> bool | None:
        """Whether somebody answers there; None if something was heard that is no answer."""
        self._asked = [*self._asked[-100:], (self._bus.now(), address)]
        try:
            await ask(self._bus, address, sign, wait)
        except DeviceRefused:
            return True
        except (NoReply, DeviceOffline):
            return None if self._heard_more() else False
        return True

    def _heard_more(self) -> bool:
        """Whether something was heard since this was last asked that is no answer in time."""
        before, self._strays = (
            self._strays,
            sum(unit.stray_bytes + unit.late_replies for unit in self._bus.stats.units.values()),
        )
        return self._strays > before


def _signs_by(function: int) -> list[Sign]:
    return [family.signs[0] for family in families().values() if family.signs and family.signs[0].function == function]


async def ask(bus: Bus, address: int, sign: Sign, wait: float) -> list[int]:
    """Ask one harmless question once. Raises as the methods of `Unit`."""
    unit = bus.unit(address)
    read = unit.read_input_registers if sign.function == 4 else unit.read_holding_registers
    return list(await read(sign.register, count=sign.count, reply_timeout=wait))


async def recognise(bus: Bus, address: int, baudrate: int, form: Format) -> Found:
    """Find out which family answers at an address, and whether it is alone there."""
    known: dict[Sign, list[int] | None] = {}
    garbled = 0
    family: Family | None = None
    for candidate in families().values():
        if not candidate.signs:
            continue
        for sign in candidate.signs:
            if sign not in known:
                known[sign], spoilt = await _surely(bus, address, sign)
                garbled += spoilt
            values = known[sign]
            if values is None or not sign.fits(values, address):
                break
        else:
            family = candidate
            break
    asked = family.signs if family is not None else [sign for sign, values in known.items() if values is not None]
    for sign in list(asked) * _AGREES:
        _, spoilt = await _surely(bus, address, sign, attempts=1)
        garbled += spoilt
    version = None
    if family is not None and family.version is not None:
        values, _ = await _surely(bus, address, family.version)
        version = None if values is None else "".join(f"{value:04X}" for value in values).lstrip("0") or "0"
    replies = [
        record.turnaround(LineSettings(baudrate=baudrate, parity=form.parity, stopbits=form.stopbits))
        for record in bus.flight
        if record.address == address and record.outcome in ("reply", "refused")
    ]
    return Found(
        address=address,
        family=None if family is None else family.name,
        title="Modbus device" if family is None else family.title,
        baudrate=baudrate,
        format=form,
        version=version,
        reply_ms=round(1000 * max(replies), 1) if replies else None,
        twins=garbled > 1,
        note=_note(address, garbled, bool(replies)),
    )


def _note(address: int, garbled: int, answers: bool) -> str:
    if garbled <= 1:
        return "" if answers else "heard once, and not again"
    return (
        f"answers are garbled: probably two drives have address {address}. Take one off the pair and give the other "
        "one another address (rs485bus setup); else look at termination and ground"
    )


async def _surely(bus: Bus, address: int, sign: Sign, attempts: int = 2) -> tuple[list[int] | None, int]:
    """What a question is answered; None for a refusal or silence. And how many answers were garbled."""
    garbled = 0
    for _ in range(attempts):
        before = bus.stats.units[address].stray_bytes if address in bus.stats.units else 0
        try:
            return await ask(bus, address, sign, _PATIENT), garbled
        except DeviceRefused:
            return None, garbled
        except (NoReply, DeviceOffline):
            stats = bus.stats.units.get(address)
            garbled += stats is not None and stats.stray_bytes > before
    return None, garbled
