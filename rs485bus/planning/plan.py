"""Airtime, rates, waits and margins of one pair, from the frames of its drives. Pure, but for the admission of
watchdogs, which the bus itself is asked for, on a virtual line.

A transaction takes the airtime of the request and of its reply, what the drive takes to begin the reply, and the
silence before the next frame.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.watchdog.reckoning import SHARE
from rs485bus.errors import WatchdogInfeasible
from rs485bus.planning.frames import DriveTraffic, Frame, learn
from rs485bus.planning.streams import between_set_points
from rs485bus.plant import Plant, PlantFile
from rs485bus.sim import VirtualClockLoop, VirtualLine
from rs485bus.wire.timing import LineSettings

TURNAROUND = 0.002
"""Seconds that a drive takes to begin its reply, where nothing else is known."""
BAUDRATES = (9600, 19200, 38400, 57600, 115200, 230400, 460800)
_CUT = 0.01
"""Seconds of silence after which a stop waits for a reply no longer."""
_MOST_DRIVES = 31
BUSY = 0.85
"""The share of the time that transactions may take: above, what is asked has to wait for its turn ever longer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairPlan:
    """One pair. Times are seconds."""

    bus: str
    line: LineSettings
    silence: float
    turnaround: float
    drives: tuple[DriveTraffic, ...]
    between_set_points: Mapping[Frame, float] = field(default_factory=dict)
    """What is sent from one set-point of the slowest axis to its next, where all are streamed at once: how many of each
    frame."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """What feeding the watchdogs takes, as in `WatchdogInfeasible.numbers`; empty where none is armed."""
    refused: str = ""
    """Why the bus refuses to arm the watchdogs."""

    def takes(self, frame: Frame) -> float:
        """How long a transaction takes the pair, the silence before the next frame included."""
        return self.line.budget(frame.request, self.answers_after, frame.reply) + self.silence

    @property
    def answers_after(self) -> float:
        """How long after a request its reply begins: a drive knows after t3.5 of silence that the request is over."""
        return max(self.turnaround, self.line.t35)

    # What it answers

    @property
    def cycle(self) -> float:
        """How long it takes to ask all axes for their positions, one after another."""
        return sum(self.takes(frame) for drive in self.drives for frame in drive.positions)

    @property
    def poll_rate(self) -> float:
        """How often a second all axes can be asked for their positions."""
        return 1 / self.cycle if self.cycle else 0.0

    @property
    def load_standing(self) -> float:
        """The share of the time in which bytes are on the pair while all stands and watchdogs are fed."""
        return self._standing(self._airtime)

    @property
    def busy_standing(self) -> float:
        """The share of the time that these transactions take, waiting and silences included."""
        return self._standing(self.takes)

    @property
    def load_moving(self) -> float:
        """The share of the time in which bytes are on the pair while all axes turn, and nobody asks anything."""
        return self._moving(self._airtime)

    @property
    def busy_moving(self) -> float:
        """The share of the time that these transactions take."""
        return self._moving(self.takes)

    @property
    def stop_wait(self) -> float:
        """How long a stop waits at the most until its first byte is sent, where all drives answer."""
        return max((self._blocks(drive.longest) for drive in self.drives), default=0.0)

    @property
    def stop_wait_behind_positions(self) -> float:
        """The same where nothing but positions is asked for."""
        return max((self._blocks(frame) for drive in self.drives for frame in drive.positions), default=0.0)

    @property
    def stop_wait_silent(self) -> float:
        """The same behind a request to a drive that does not answer."""
        longest = max((drive.longest.request for drive in self.drives), default=0)
        return self.line.airtime(longest) + self._cut_after + self.silence

    @property
    def stop_all(self) -> float:
        """How long it takes from then on until the stops of all drives are on the pair and acknowledged."""
        return sum(self.takes(frame) for drive in self.drives for frame in drive.stops)

    @property
    def set_point_rate(self) -> float:
        """How often a second the slowest axis can be told another speed, where all are streamed at once. 0 where so
        many may not turn at once."""
        takes = sum(count * self.takes(frame) for frame, count in self.between_set_points.items())
        return 1 / takes if takes else 0.0

    @property
    def fits(self) -> bool:
        """Whether the watchdogs can be fed, and there is time for more beside what moving axes need."""
        return not self.refused and self.busy_moving <= BUSY

    @property
    def problem(self) -> str:
        """Why it does not fit; empty if it does."""
        if self.refused:
            return self.refused
        if self.busy_moving > BUSY:
            return f"moving axes alone would take the pair for {self.busy_moving:.0%} of the time"
        return ""

    def margin(self, drive: DriveTraffic) -> float | None:
        """How long the pair may be taken by something else beyond the longest request, lest this watchdog trips."""
        if drive.watchdog is None or not self.numbers:
            return None
        return drive.watchdog * (1 - SHARE) - self.numbers["needed"]

    # Inside

    @property
    def _cut_after(self) -> float:
        return max(_CUT, 2 * self.silence + self.line.character)

    def _blocks(self, frame: Frame) -> float:
        if self.answers_after > self._cut_after:
            return self.line.airtime(frame.request) + self._cut_after + self.silence
        return self.takes(frame)

    def _airtime(self, frame: Frame) -> float:
        return self.line.airtime(frame.size)

    def _standing(self, takes: Callable[[Frame], float]) -> float:
        return sum(drive.fed_rate * takes(drive.feed) for drive in self.drives if drive.feed)

    def _moving(self, takes: Callable[[Frame], float]) -> float:
        return sum(rate * takes(frame) for drive in self.drives for rate, frame in drive.moving)


def plan(file: PlantFile, *, turnaround: float = TURNAROUND) -> list[PairPlan]:
    """Plan each bus of a plant.

    Args:
        file: the plant.
        turnaround: seconds that drives take to begin a reply.

    Raises:
        PlantFileError, NotSupported, BusError: as `learn`.
    """
    return [plan_bus(file, bus, turnaround) for bus in file.buses]


def plan_bus(file: PlantFile, bus: str, turnaround: float) -> PairPlan:
    """Plan one bus."""
    entry = file.buses[bus]
    line = LineSettings(baudrate=entry.baudrate or 115200, parity=entry.parity, stopbits=entry.stopbits)
    drives = learn(file, bus)
    gateway = entry.port.startswith(("tcp://", "socket://"))
    silence = entry.config.silence_on(line, gateway)
    pair = PairPlan(bus=bus, line=line, silence=silence, turnaround=turnaround, drives=tuple(drives))
    return admitted(pair, file, listen=True)


def at_baudrate(pair: PairPlan, file: PlantFile, baudrate: int) -> PairPlan:
    """The same drives on a pair of another rate."""
    line = LineSettings(baudrate=baudrate, parity=pair.line.parity, stopbits=pair.line.stopbits)
    return admitted(replace(pair, line=line, silence=line.t35, numbers={}, refused=""), file)


def with_drives(pair: PairPlan, file: PlantFile, count: int) -> PairPlan:
    """So many drives, of the same kinds in turns."""
    drives = tuple(replace(pair.drives[at % len(pair.drives)], address=at + 1) for at in range(count))
    return admitted(replace(pair, drives=drives, numbers={}, refused=""), file)


def most_drives(pair: PairPlan, file: PlantFile) -> int:
    """With how many drives of these kinds it still fits, up to 31: so many stand on one pair without a repeater."""
    low, high = 0, _MOST_DRIVES
    while low < high:
        middle = (low + high + 1) // 2
        if with_drives(pair, file, middle).fits:
            low = middle
        else:
            high = middle - 1
    return low


def admitted(pair: PairPlan, file: PlantFile, *, listen: bool = False) -> PairPlan:
    """Ask the bus itself whether it would arm the watchdogs; and perhaps listen how often it feeds each drive then."""
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        return runner.run(_admitted(pair, file, listen))


async def _admitted(pair: PairPlan, file: PlantFile, listen: bool) -> PairPlan:
    plant = virtual_plant(pair, file)
    try:
        async with plant:
            reckoning = plant.buses[pair.bus].owner.feeding.reckoning
            pair = replace(pair, numbers={} if reckoning is None else reckoning.numbers)
            return await _listened(pair, plant) if listen else pair
    except WatchdogInfeasible as refused:
        return replace(pair, numbers=refused.numbers, refused=str(refused))


async def _listened(pair: PairPlan, plant: Plant) -> PairPlan:
    """How often each drive is fed beside the others, for those that are due soon are fed together; and what their
    streams send."""
    listens = await settle(pair, plant)
    fed: Counter[int] = Counter()
    plant.buses[pair.bus].subscribe(lambda record: fed.update({record.address: record.urgency is Urgency.FEED}))
    await asyncio.sleep(listens)
    drives = tuple(replace(drive, fed_rate=fed[drive.address] / listens) for drive in pair.drives)
    sent, _ = await between_set_points(list(plant.axes.values()))
    return replace(pair, drives=drives, between_set_points=sent)


async def settle(pair: PairPlan, plant: Plant) -> float:
    """Enable all axes of a virtual plant, and wait until feeding has found its rhythm.

    Returns:
        Seconds for which it is worth to listen then.
    """
    for axis in plant.axes.values():
        await axis.enable()
        await axis.position()
    longest = max((drive.fed for drive in pair.drives), default=0.0)
    await asyncio.sleep(2 * longest)
    return 6 * longest or 1.0


def virtual_plant(pair: PairPlan, file: PlantFile) -> Plant:
    """The drives of a plan on a virtual line: each is a copy of the one of its kind in the plant."""
    axes = {}
    for drive in pair.drives:
        for name, entry in file.axes.items():
            if entry.bus == pair.bus and entry.address == drive.kind:
                options = {key: value for key, value in entry.options.items() if key != "limits"}
                copy = {"address": drive.address, "options": options}
                axes[f"{name}@{drive.address}"] = entry.model_copy(update=copy)
    bus = file.buses[pair.bus].model_copy(update={"baudrate": pair.line.baudrate})
    alone = {"axes": axes, "buses": {pair.bus: bus}, "groups": {}, "vehicle": None}
    plant = Plant(file.model_copy(update=alone), sim=True, watchdogs=not pair.refused)
    for line in plant.lines.values():
        assert isinstance(line, VirtualLine)
        line.pair.turnaround = pair.turnaround
    return plant
