"""How lost units are looked for: how often, and what they are asked. Pure.

Listening to a unit that does not answer takes the wire from all others, so it is rationed. On a bus that others use,
all lost units share an account that fills slowly. A unit that comes and goes costs its last requests each time it goes;
that, too, is paid for with time in which it is not looked for. On an idle bus each is looked for every other second.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rs485bus.wire.answers import READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT
from rs485bus.wire.frames import HIGHEST_ADDRESS, Request, read_holding, read_input

SHARE = 0.019
"""The part of all time that may be spent on looking for lost units; as much again on those that come and go. With what
a unit is asked until it is known to be lost that stays below 5 %."""
BURST = 0.25
"""Seconds that may be spent on looking at once."""
IDLE_SHARE = 0.048
"""The same parts for a bus that is idle otherwise, in all."""
IDLE_EVERY = 1.8
"""Seconds between two looks for the same unit on an idle bus."""
_PLAIN_READS = (READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT)
_PLACE_OF_A_READ = 5
_KNOWN = 32
"""Requests that a unit has answered, of which it is remembered."""
_PATIENCE = 0.75
"""The part of its reply timeout for which a lost unit is listened to. Its late reply is noticed all the same."""
_FACTOR, _SHORTEST = 4.0, 0.01


class ProbeBudget:
    """The account of the time spent on looking for lost units.

    Args:
        share: the part of all time that may be spent.
        burst: seconds that may be spent at once.
    """

    __slots__ = ("_at", "_burst", "_level", "_share")

    def __init__(self, share: float = SHARE, burst: float = BURST) -> None:
        self._share = share
        self._burst = burst
        self._level = 0.0
        self._at = 0.0

    def spend(self, seconds: float, now: float) -> None:
        self._level = self._drained(now) + seconds
        self._at = now

    def free_at(self, now: float) -> float:
        """When there is something to spend again."""
        return now + max(0.0, self._drained(now) - self._burst) / self._share

    def _drained(self, now: float) -> float:
        return max(0.0, self._level - self._share * (now - self._at))


class AnsweredRequests:
    """What a unit has answered, and what it is asked to see whether it is there."""

    __slots__ = ("_asked", "_known", "_refused", "latest", "unanswered")

    def __init__(self) -> None:
        self.latest: Request | None = None
        """The read that it answered last."""
        self.unanswered: Request | None = None
        """The read that it left unanswered last."""
        self._known: dict[bytes, None] = {}
        self._refused: set[bytes] = set()
        self._asked = 0

    def __contains__(self, request: Request) -> bool:
        return _place(request) in self._known

    def add(self, request: Request) -> None:
        """It answered this, be it by an exception."""
        self._asked = 0
        if request.function in _PLAIN_READS:
            self.latest = request
        known, place = self._known, _place(request)
        known.pop(place, None)
        known[place] = None
        if len(known) > _KNOWN:
            oldest = next(iter(known))
            del known[oldest]
            self._refused.discard(oldest)

    def missed(self, request: Request) -> None:
        """It did not answer this."""
        if request.function in _PLAIN_READS:
            self.unanswered = request

    def refused(self, request: Request) -> None:
        """It answered this by an exception."""
        self._refused.add(_place(request))

    def shorter(self, address: int) -> Iterator[Request]:
        """Reads of a part of what it has answered, the latest first; each from the same register on."""
        for place in reversed(self._known):
            function, register, count = place[0], int.from_bytes(place[1:3], "big"), int.from_bytes(place[3:5], "big")
            read = {READ_HOLDING: read_holding, READ_INPUT: read_input}.get(function)
            if read is not None and len(place) == _PLACE_OF_A_READ and place not in self._refused:
                for less in range(count - 1, 0, -1):
                    yield read(address, register, less, HIGHEST_ADDRESS)

    def next_probe(self, address: int, own: Sequence[Request]) -> Request:
        """What to ask next to see whether anybody answers: every other time what was answered last, else something
        else.

        Args:
            address: the unit's.
            own: the reads of its family that have no side effects; empty where that is not known.
        """
        known = self.latest
        turn, self._asked = self._asked, self._asked + 1
        others = [request for request in _others(address, own, self.unanswered) if request is not known]
        if known is None:
            return others[turn % len(others)]
        return others[turn // 2 % len(others)] if turn % 2 and others else known


def listening_time(reply_timeout: float, longest: float) -> float:
    """Seconds for which a lost unit is listened to that may take `reply_timeout`, and took `longest` at most when it
    was there; 0 if that is not known."""
    patient = _PATIENCE * reply_timeout
    return min(patient, max(_SHORTEST, _FACTOR * longest)) if longest else patient


def _others(address: int, own: Sequence[Request], unanswered: Request | None) -> Iterator[Request]:
    if own:
        yield from own
        return
    if unanswered is not None:
        yield unanswered
    yield read_holding(address, 0, 1, HIGHEST_ADDRESS)
    yield read_input(address, 0, 1, HIGHEST_ADDRESS)


def _place(request: Request) -> bytes:
    """What makes two requests the same to a unit: function and register, and of a read how much of it."""
    return request.adu[1:4] if request.writes else request.adu[1:6]
