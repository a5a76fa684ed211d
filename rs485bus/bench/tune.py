"""Measuring a pair with its drives: how long each takes to answer, the shortest silence and the highest rate at which
nothing is lost.

Only harmless reads are sent, one after another without a pause. The rate is changed drive by drive, if that is asked
for, and taken back where something is lost.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rs485bus.bench.scan import Format, PortOf, ask, open_line
from rs485bus.bench.setup import NewDrive, PowerCycle
from rs485bus.bus.bus import Bus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.record import Record
from rs485bus.errors import BusError, NoReply, RequestFailed
from rs485bus.plant.families import families
from rs485bus.wire.timing import LineSettings

ROUNDS = 100
"""Questions to each drive."""
MARGIN = 1.5
"""How much longer than the shortest silence that lost nothing it is set to."""
REPLY_MARGIN = 4.0
"""How many times the longest answer is waited for."""
SHORTEST_TIMEOUT = 0.03
_WORTH_IT = 0.85
"""A silence is worth setting below this part of t3.5."""
_STEPS = 5
_FIRST_WAIT = 0.3

Drives = Mapping[int, str]
"""The drives on a pair: families by address."""


@dataclass(frozen=True, slots=True)
class Trial:
    """What came of some hundred questions."""

    asked: int
    lost: int
    replies: Mapping[int, float]
    """Seconds before each drive's answer began, at the longest, by address."""


@dataclass(slots=True, kw_only=True)
class Tuned:
    """What was measured on one pair, and what is kept of it."""

    line: LineSettings
    replies: dict[int, float] = field(default_factory=dict)
    shortest: float | None = None
    """The shortest silence at which nothing was lost, in seconds; None where it was not looked for."""
    asked: int = 0
    remarks: list[str] = field(default_factory=list)

    @property
    def silence(self) -> float | None:
        """The silence to keep; None for that of Modbus (t3.5), where less is not worth it."""
        if self.shortest is None:
            return None
        kept = max(MARGIN * self.shortest, self.line.shortest_silence)
        return round(kept, 6) if kept <= _WORTH_IT * self.line.t35 else None

    def reply_timeout(self, address: int) -> float:
        """How long a drive's answers should be waited for, in seconds."""
        return round(max(SHORTEST_TIMEOUT, REPLY_MARGIN * self.replies[address]), 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """A pair with its drives.

    Args:
        port: what is opened for some line settings.
        drives: families by address.
        line: how it is set now.
        config: how the bus is set now.
        rounds: questions to each drive in a trial.
        tell: is told what goes on.
    """

    port: PortOf
    drives: Drives
    line: LineSettings
    config: BusConfig
    rounds: int = ROUNDS
    tell: Callable[[str], None] = lambda text: None

    async def run(self, rates: Sequence[int], power_cycle: PowerCycle, agrees: Callable[[str], bool]) -> Tuned:
        """Measure the pair; at higher rates, too, where there are any to try.

        Args:
            rates: bit/s, each higher than the present one.
            power_cycle: has a drive switched off and on that takes a rate only then.
            agrees: asks whether the drives may be set to a rate.

        Raises:
            NoReply: a drive does not answer, or something is lost at the present rate.
        """
        tuned = Tuned(line=self.line)
        first = await self._surely(self.line)
        tuned.replies = dict(first.replies)
        for rate in rates:
            if not agrees(f"Set all drives of this pair to {rate} bit/s, which each keeps, and try that?"):
                break
            if not await self._at_rate(tuned, rate, power_cycle):
                break
        tuned.shortest = await self._shortest_silence(tuned)
        return tuned

    # The rate

    async def _at_rate(self, tuned: Tuned, rate: int, power_cycle: PowerCycle) -> bool:
        """Whether nothing is lost at a higher rate. If it is, the drives have their former one again."""
        before, after = tuned.line, replace(tuned.line, baudrate=rate)
        changed = await self._change(before, after, list(self.drives), power_cycle, tuned)
        if len(changed) == len(self.drives):
            trial = await self._trial(after, self.config)
            self.tell(f"{rate} bit/s: {trial.lost} of {trial.asked} lost")
            if not trial.lost:
                tuned.line, tuned.replies = after, dict(trial.replies)
                return True
            tuned.remarks.append(f"{rate} bit/s loses {trial.lost} of {trial.asked} answers")
        await self._change(after, before, changed, power_cycle, tuned)
        return False

    async def _change(
        self, old: LineSettings, new: LineSettings, addresses: list[int], power_cycle: PowerCycle, tuned: Tuned
    ) -> list[int]:
        """Set drives to another rate, one after another. Returns those that are known to have it."""
        changed = []
        for address in addresses:
            form = Format(old.parity, old.stopbits)
            family = self.drives[address]
            drive = NewDrive(port=self.port, family=family, address=address, baudrate=old.baudrate, format=form)
            try:
                result = await drive.set_baudrate(new.baudrate, power_cycle)
            except BusError as error:
                tuned.remarks.append(f"{families()[family].title} {address}: {error}")
                break
            if not result.confirmed:
                tuned.remarks.append(f"{families()[family].title} {address}: {result.message}")
                break
            changed.append(address)
        return changed

    # The silence

    async def _shortest_silence(self, tuned: Tuned) -> float:
        """The shortest silence at which nothing is lost: halved in between, from t3.5 to 1.5 characters."""
        line = tuned.line
        good, bad = line.t35, line.shortest_silence
        if bad >= good or (await self._trial(line, self._with(bad))).lost == 0:
            return min(good, bad)
        for _ in range(_STEPS):
            middle = (good + bad) / 2
            lost = (await self._trial(line, self._with(middle))).lost
            self.tell(f"silence {1000 * middle:.2f} ms: {'nothing' if not lost else 'something'} lost")
            good, bad = (good, middle) if lost else (middle, bad)
        return good

    def _with(self, silence: float) -> BusConfig:
        return replace(self.config, silence=silence)

    # One trial

    async def _surely(self, line: LineSettings) -> Trial:
        trial = await self._trial(line, replace(self.config, silence=None))
        missing = [address for address in self.drives if address not in trial.replies]
        if missing:
            raise NoReply(
                f"Nobody answers at address {missing[0]} at {line.baudrate} bit/s. rs485bus scan tells who is where."
            )
        if trial.lost:
            raise NoReply(
                f"{trial.lost} of {trial.asked} answers are lost at {line.baudrate} bit/s already. Look at "
                "termination, ground and shielding first: there is nothing to tune yet."
            )
        return trial

    async def _trial(self, line: LineSettings, config: BusConfig) -> Trial:
        """Ask all drives again and again, without a pause, until enough was asked or something is lost."""
        config = replace(config, retries=0, offline_after=100, reply_timeout=_FIRST_WAIT, late_reply_window=0.1)
        async with open_line(self.port, line, config) as bus:
            records: list[Record] = []
            end = bus.subscribe(records.append)
            outcomes = await asyncio.gather(*(self._ask(bus, address) for address in self.drives))
            end()
            replies: dict[int, float] = {}
            for record in records:
                if record.outcome == "reply":
                    took = record.turnaround(line)
                    replies[record.address] = max(took, replies.get(record.address, 0.0))
        return Trial(sum(asked for asked, _ in outcomes), sum(lost for _, lost in outcomes), replies)

    async def _ask(self, bus: Bus, address: int) -> tuple[int, int]:
        sign = families()[self.drives[address]].signs[0]
        for number in range(1, self.rounds + 1):
            try:
                await ask(bus, address, sign, _FIRST_WAIT)
            except RequestFailed:
                return number, 1
        return self.rounds, 0
