"""What goes next. Pure: the owner says which job may go, the queue says in which order to ask.

Urgency decides first. Within an urgency each address has a line of its own, first in, first out, and the addresses
take turns. Every step costs O(1) in the number of jobs. Commands that never end do not starve the polls.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence

from rs485bus.bus.schedule.job import COMMAND, CONFIRM, FEED, POLL, Job, Urgency
from rs485bus.wire.frames import Request

READY = 0.0
"""An admission: the job may go now."""
GONE = -1.0
"""An admission: the job is not worth sending any more; it leaves the queue."""

_FOREVER = float("inf")
_PATIENCE = 3
"""Commands after which a poll that waited all the while has its turn; looks after which commands and polls have one."""
_PUT_OFF = 2 * _PATIENCE - 1
"""Looks and set-points after which the last frame of a set-point puts off the turn of the rest no longer."""
_SOON = (Urgency.FEED, Urgency.CONFIRM)
_REST = (Urgency.COMMAND, Urgency.POLL)
_POLLS_FIRST = (Urgency.POLL, Urgency.COMMAND)

Admission = Callable[[Job], float]
"""Asked of a job at the head of its line: READY, GONE, or the time until which it must wait."""


class Queue:
    """Jobs that wait for the wire."""

    __slots__ = ("_lanes", "_look_next", "_looks", "_passed", "_polls", "_soon", "size", "stops")

    def __init__(self) -> None:
        # Lines are ordered dicts keyed by the job itself: O(1) to append, to take the first and to leave anywhere.
        self._lanes: tuple[OrderedDict[int, OrderedDict[Job, None]], ...] = tuple(OrderedDict() for _ in Urgency)
        self.stops = self._lanes[Urgency.STOP]
        """Not empty, while a stop waits."""
        self._soon = self._lanes[Urgency.FEED], self._lanes[Urgency.CONFIRM]
        self._polls = self._lanes[Urgency.POLL]
        self._passed = 0
        """How many commands in a row have gone before a poll that waited."""
        self._looks = 0
        """How many looks and set-points in a row have gone before commands and polls that waited."""
        self._look_next = True
        """The next turn of those that were passed is that of a look."""
        self.size = 0

    def put(self, job: Job, *, first: bool = False) -> None:
        """Add a job to the end of its address' line; with `first` to its head, as a repetition goes."""
        lane = self._lanes[job.urgency]
        line = lane.get(job.address)
        if line is None:
            line = lane[job.address] = OrderedDict()
        line[job] = None
        if first:
            line.move_to_end(job, last=False)
        if job.goes_on:
            lane.move_to_end(job.address, last=False)
        self.size += 1

    def hurry(self, job: Job) -> None:
        """The job's address has its turn before the others of its urgency, if the job waits."""
        lane = self._lanes[job.urgency]
        if job.address in lane:
            lane.move_to_end(job.address, last=False)

    def remove(self, job: Job) -> bool:
        """Take a job out, wherever it stands. False if it does not wait here."""
        lane = self._lanes[job.urgency]
        line = lane.get(job.address)
        if line is None or job not in line:
            return False
        del line[job]
        if not line:
            del lane[job.address]
        self.size -= 1
        return True

    def take(self, admit: Admission, lanes: range | tuple[Urgency, ...] = tuple(Urgency)) -> tuple[Job | None, float]:
        """The next job that may go, taken out; and, if there is none, when to ask again.

        The time is infinite if nothing waits for time to pass.
        """
        again = _FOREVER
        for urgency in lanes:
            lane = self._lanes[urgency]
            if not lane:
                continue
            for address in tuple(lane):
                while (line := lane.get(address)) is not None:
                    job, verdict = _first(line, admit)
                    if verdict > READY:
                        again = min(again, verdict)
                        break
                    if verdict != READY:
                        self.remove(job)
                        continue
                    del line[job]
                    self.size -= 1
                    if line:
                        lane.move_to_end(address)
                    else:
                        del lane[address]
                    return job, 0.0
        return None, again

    def take_soon(self, admit: Admission, now: float) -> tuple[Job | None, float]:
        """As `take`, for feeds, and for looks and set-points.

        Where drives are slow these would fill the wire, and nothing else would ever end: after some of them the rest
        has a turn, unless a set-point that goes next is in a hurry.
        """
        feeds, looks = self._soon
        if not (feeds or looks):
            self._looks = 0
            return None, _FOREVER
        if self._looks >= _PATIENCE and not self._goes_on(now):
            self._looks = min(self._looks, _PUT_OFF) - _PATIENCE
            job, _ = self.take(admit, (FEED,))
            if job is None:
                job = self._take_passed(admit)
            if job is not None:
                return job, 0.0
        job, again = self.take(admit, _SOON)
        if job is None or job.urgency is not CONFIRM:
            self._looks = 0
        elif self.has(COMMAND) or self.has(POLL) or (job.goes_first and self._look(job.address)):
            self._looks += 1
        else:
            self._looks = 0
        return job, again

    def _goes_on(self, now: float) -> bool:
        """Whether a set-point that goes next puts off the turn of the rest."""
        job = next((next(iter(line)) for line in self._lanes[CONFIRM].values()), None)
        return job is not None and (job.yields_until <= now or (job.goes_on and self._looks < _PUT_OFF))

    def _take_passed(self, admit: Admission) -> Job | None:
        """What was passed by looks and set-points: by turns, a look that set-points to its drive go before, and one of
        the rest."""
        looks = self._lanes[CONFIRM].items() if self._look_next else ()
        look = next((self._look(address) for address, line in looks if next(iter(line)).goes_first), None)
        self._look_next = not self._look_next
        if look is not None and admit(look) == READY:
            self.remove(look)
            return look
        return self.take_rest(admit)[0]

    def _look(self, address: int) -> Job | None:
        """A look at a drive that waits, perhaps behind set-points to it."""
        return next((job for job in self._lanes[CONFIRM].get(address, ()) if job.is_look), None)

    def take_rest(self, admit: Admission) -> tuple[Job | None, float]:
        """As `take`, for commands and polls.

        Commands go first; but whoever asks without a pause, command after command, would keep the moves of all axes
        from being looked at, and they would never end. So after some commands a poll has its turn.
        """
        waits = bool(self._polls)
        job, again = self.take(admit, _POLLS_FIRST if self._passed >= _PATIENCE else _REST)
        if job is not None:
            self._passed = self._passed + 1 if waits and job.urgency is COMMAND else 0
        return job, again

    def take_of(self, address: int, admit: Admission) -> Job | None:
        """The next job for one address that may go, taken out. Stops and feeds are not looked at."""
        for urgency in (Urgency.CONFIRM, *_REST):
            lane = self._lanes[urgency]
            while (line := lane.get(address)) is not None:
                job, verdict = _first(line, admit)
                if verdict > READY:
                    break
                self.remove(job)
                if verdict == READY:
                    if address in lane:
                        lane.move_to_end(address)
                    return job
        return None

    def has(self, urgency: Urgency, address: int | None = None) -> bool:
        """Whether a job of this urgency waits (for this address)."""
        lane = self._lanes[urgency]
        return bool(lane) if address is None else address in lane

    def heads(self, urgency: Urgency) -> list[Job]:
        """The first job of this urgency for each address."""
        return [next(iter(line)) for line in self._lanes[urgency].values()]

    def of_urgency(self, urgency: Urgency) -> Iterator[Job]:
        """The jobs that wait with this urgency."""
        for line in list(self._lanes[urgency].values()):
            yield from list(line)

    def next_of(self, address: int) -> Iterator[Job]:
        """The job for one address that goes next of each urgency. Questions of the bus' own keep nobody waiting."""
        for lane in self._lanes:
            job = next((job for job in lane.get(address, ()) if not job.backs_off), None)
            if job is not None:
                yield job

    def keeping_nobody_waiting(self, address: int, reads: Sequence[Request]) -> list[Request]:
        """Those reads of a unit whose answers cannot be taken for what somebody waits for: who waits would have to
        wait for longer, if they were late."""
        waiting = list(self.next_of(address))
        return [read for read in reads if not any(read.may_answer(job.request) for job in waiting)]

    def __iter__(self) -> Iterator[Job]:
        for urgency in Urgency:
            yield from self.of_urgency(urgency)

    def of(self, address: int) -> list[Job]:
        """The jobs that wait for one address."""
        return [job for lane in self._lanes for job in lane.get(address, ())]


def _first(line: OrderedDict[Job, None], admit: Admission) -> tuple[Job, float]:
    """The job of a line that goes first, and whether it may. A question of the bus' own keeps nobody waiting, unless it
    was not answered: as long as its device is silent, what others ask would only be owed as well."""
    job, again = next(iter(line)), _FOREVER
    asks = job.backs_off and not job.unanswered
    other = next((other for other in line if not other.backs_off), None) if asks else None
    if other is not None and (again := admit(other)) <= READY:
        return other, again
    return job, min(admit(job), again)
