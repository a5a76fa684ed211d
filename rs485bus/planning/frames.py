"""Which frames a drive's facade sends: learned from the facade itself, on a virtual line, one drive at a time.

So nothing is said twice: what a question for the position costs is what the facade asks, not what a table remembers.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from rs485bus.bus.record import Record
from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.watchdog.reckoning import SHARE
from rs485bus.plant import AxisEntry, Plant, PlantFile
from rs485bus.sim import VirtualClockLoop

_WATCHED = 4.0
"""Seconds for which a drive is listened to."""
_SETTLES = 1.0
_LEISURE = 3.0
_SPEED = 30.0
"""rpm at which a drive turns meanwhile."""


class Frame(NamedTuple):
    """A request and its reply, in bytes."""

    request: int
    reply: int

    @property
    def size(self) -> int:
        return self.request + self.reply


_Rates = tuple[tuple[float, Frame], ...]
"""How often something is sent, and what."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveTraffic:
    """What one drive asks of the pair."""

    address: int
    kind: int
    """The address in the plant of a drive of the same kind."""
    family: str
    axes: tuple[str, ...]
    watchdog: float | None
    """Seconds; None where it is not guarded."""
    positions: tuple[Frame, ...]
    """What asks for the positions of all its axes, once."""
    feed: Frame | None
    """What it is asked while it stands and nobody asks anything; None where that is nothing."""
    fed_rate: float
    """How often a second."""
    fed: float
    """The watchdog's time for which that is done, in seconds; 0 for none. One that a drive was shipped with counts."""
    stops: tuple[Frame, ...]
    """What stops all its axes."""
    moving: _Rates
    """What is sent while all its axes turn and nobody asks anything: how often a second, and what."""

    @property
    def longest(self) -> Frame:
        """The longest of these."""
        frames = [*self.positions, *self.stops, *(frame for _, frame in self.moving)]
        return max(frames, key=lambda frame: frame.size)


def learn(file: PlantFile, bus: str) -> list[DriveTraffic]:
    """The traffic of all drives on a bus of a plant.

    Raises:
        PlantFileError: an option is out of its range.
        NotSupported: a family has no virtual drive.
        BusError: a facade fails on its virtual drive.
    """
    known: dict[str, DriveTraffic] = {}
    found = []
    for address, axes in file.drives(bus):
        entries = {name: _free(entry) for name, entry in axes.values()}
        names, entry = tuple(entries), next(iter(entries.values()))
        kind = repr((entry.family, entry.watchdog, [(axis.side, axis.options) for axis in entries.values()]))
        if kind not in known:
            with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
                known[kind] = runner.run(_learn(file.model_copy(update=_alone(entries)), names))
        alike = known[kind]
        found.append(replace(alike, address=address, kind=address, axes=names))
    return found


def _free(entry: AxisEntry) -> AxisEntry:
    """The axis without limits, which would end a run."""
    options = {name: value for name, value in entry.options.items() if name != "limits"}
    return entry.model_copy(update={"options": options})


def _leisurely(entry: AxisEntry) -> AxisEntry:
    """The axis with a watchdog that can be fed on any line: what feeds it is the same."""
    return entry.model_copy(update={"watchdog": entry.watchdog and max(_LEISURE, entry.watchdog)})


def _alone(entries: dict[str, AxisEntry]) -> dict[str, Any]:
    return {"axes": entries, "groups": {}, "vehicle": None}


async def _learn(file: PlantFile, names: Sequence[str]) -> DriveTraffic:
    """Have one drive do everything once, and listen."""
    entry = file.axes[names[0]]
    axes_entries = {name: _leisurely(axis) for name, axis in file.axes.items()}
    plant = Plant(file.model_copy(update={"axes": axes_entries}), sim=True)
    async with plant:
        axes = [plant.axes[name] for name in names]
        bus, records = axes[0].bus, list[Record]()
        for axis in axes:
            await axis.enable()
            await axis.position()
        await asyncio.sleep(_SETTLES)
        bus.subscribe(records.append)
        for axis in axes:
            await axis.position()
        positions = [frame_of(record) for record in records if record.urgency is not Urgency.FEED]
        records.clear()
        await asyncio.sleep(max(_WATCHED, 3 * _LEISURE))
        feeds = [record for record in records if record.urgency is Urgency.FEED]
        for axis in axes:
            await axis.run(min(_SPEED, axis.rpm))
        await asyncio.sleep(_SETTLES)
        records.clear()
        await asyncio.sleep(_WATCHED)
        watched = _rates(records, _WATCHED)
        records.clear()
        for stop in [axis.stop() for axis in axes]:
            await stop
        stops = [frame_of(record) for record in records if record.urgency is Urgency.STOP]
    fed = entry.watchdog or _apart(feeds) / SHARE
    return DriveTraffic(
        address=entry.address,
        kind=entry.address,
        family=entry.family,
        axes=tuple(names),
        watchdog=entry.watchdog,
        positions=tuple(positions),
        feed=_usual(map(frame_of, feeds)),
        fed_rate=1 / (SHARE * fed) if fed else 0.0,
        fed=fed,
        stops=tuple(stops),
        moving=watched,
    )


def _rates(records: Iterable[Record], per: float) -> _Rates:
    return tuple((count / per, frame) for frame, count in Counter(map(frame_of, records)).items())


def frame_of(record: Record) -> Frame:
    """A transaction, in bytes."""
    return Frame(len(record.request), len(record.reply))


def _apart(records: Sequence[Record]) -> float:
    """Seconds between two of some records; 0 for fewer than three."""
    if len(records) < 3:
        return 0.0
    return (records[-1].sent_at - records[0].sent_at) / (len(records) - 1)


def _usual(frames: Iterable[Frame]) -> Frame | None:
    most = Counter(frames).most_common(1)
    return most[0][0] if most else None
