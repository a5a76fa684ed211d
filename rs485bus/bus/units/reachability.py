"""Whether a unit answers, judged by evidence. Pure.

A unit is taken for dead when its silence is too unlikely for the loss that the line shows, and not after a fixed count:
a bad line loses many frames of a unit that is there. What is no evidence is not counted: a request that the unit has
never answered may be one that it does not answer, and then it is asked for something that it has answered before.
"""

from __future__ import annotations

import math

from rs485bus.bus.units.probing import SHARE

FLAPPING = 60.0
"""Seconds within which a unit that falls silent again counts as coming and going."""
_DOUBTS = 3
"""Attempts that are no evidence after which the unit is asked for what it has answered before."""
_NEVER = float("-inf")

LEAST = 0.01
"""The loss that is assumed of the best line."""
UNLIKELY = 1e-9
"""A silence less likely than this, for the loss that the line shows, is no silence of a unit that is there."""
_MEMORY = 100.0
"""Attempts after which an older one counts a third."""
_USUAL = 0.05
"""The loss that is assumed of a line of which nothing is known."""
_FEW = 5.0
"""Attempts that what is assumed counts for, so that the first losses are believed."""


class Loss:
    """How much of what one unit is asked is lost.

    Only attempts that stand between two of its answers are counted: those were lost by the line, for it was there.
    """

    __slots__ = ("_answered", "_lost", "answers")

    def __init__(self) -> None:
        self.answers = 0
        """Attempts answered since the latest that was lost. Whoever hears the unit counts them here."""
        self._answered = 0.0
        self._lost = 0.0

    def between_answers(self, lost: int) -> None:
        """So many attempts were lost, and then one was answered."""
        faded = math.exp(-(self.answers + lost) / _MEMORY)
        self._answered = self._answered * faded + self.answers
        self._lost = self._lost * faded + lost
        self.answers = 0

    @property
    def counts(self) -> tuple[float, float]:
        """How many were lost and answered of late."""
        faded = math.exp(-self.answers / _MEMORY)
        return self._lost * faded, self._answered * faded + self.answers


def share_lost(lost: float, answered: float, usual: float = _USUAL) -> float:
    """The share that is lost, where so many were and so many were not. `usual` is the share that is likely anyway."""
    return max(LEAST, (lost + _FEW * usual) / (lost + answered + _FEW))


def longest_silence(loss: float) -> int:
    """How many attempts in a row may be lost, by chance, of a unit that is there."""
    return math.floor(math.log(UNLIKELY) / math.log(loss))


class Reachability:
    """Whether one unit answers."""

    __slots__ = (
        "_doubts",
        "_flapping",
        "_heard_at",
        "_is_settled",
        "_listened",
        "_longest",
        "_requests",
        "_silent_at",
        "_streak",
        "loss",
        "offline",
        "probe_at",
        "probed_at",
    )

    def __init__(self) -> None:
        self.offline = False
        self.probe_at = 0.0
        """Not to be looked for before, on a bus that others use."""
        self.probed_at = 0.0
        """When it was looked for last, or went offline."""
        self.loss = Loss()
        self._streak = 0
        """Attempts in a row that were not answered, of requests that it answers."""
        self._doubts = 0
        """Attempts in a row that were not answered, of others."""
        self._requests = 0
        """Requests in a row that ended without an answer."""
        self._listened = 0.0
        self._flapping = 0
        self._longest = longest_silence(LEAST)
        """How many attempts in a row the line may lose by chance."""
        self._silent_at = _NEVER
        self._heard_at = _NEVER
        self._is_settled = True
        """Nothing has been missed since its latest answer."""

    @property
    def silent(self) -> bool:
        """Whether it seems to have fallen silent. Nothing is repeated then: repetitions are for what a line loses."""
        return max(self._streak, self._doubts) >= self._longest

    @property
    def gave_up(self) -> bool:
        """Whether a request ended without an answer, and nothing was heard of it since."""
        return self._requests > 0

    @property
    def in_doubt(self) -> bool:
        """Whether it is to be asked for what it has answered before: what it left unanswered is no evidence."""
        return self._doubts >= _DOUBTS and not self.offline

    def flaps(self, now: float) -> bool:
        """Whether it fell silent only just now."""
        return now - self._silent_at < FLAPPING

    def answered(self) -> bool:
        """The unit answered. True if it was offline until now."""
        self.loss.answers += 1
        if self._is_settled:
            return False
        back, self.offline = self.offline, False
        if not back:
            self.loss.between_answers(self._streak)
        self._streak = self._doubts = self._requests = 0
        self._listened = 0.0
        self._longest = longest_silence(LEAST)
        self._is_settled = True
        return back

    def heard(self, now: float) -> bool:
        """The unit gave a sign of life that answers nothing that is waited for. As `answered`."""
        self._heard_at = now
        return self.answered()

    def doubted(self, now: float, listened: float) -> None:
        """An attempt was not answered, of a request that the unit may never answer."""
        if now - listened > self._heard_at:
            self._is_settled = False
            self._listened += listened
            self._doubts += 1

    def asked_for_what_it_answers(self) -> None:
        """Whether it is there is being found out; if it does not answer, again after the next attempt in vain."""
        self._doubts = _DOUBTS - 1

    def unanswered(self, now: float, listened: float, flapping: int, loss: float = LEAST) -> bool:
        """An attempt was not answered, of a request that the unit answers. True if that happens too often in a row to
        be the line's doing.

        Args:
            now: the time.
            listened: how many seconds were listened for it.
            flapping: how many units come and go. One that does is looked for less often on a bus that others use.
            loss: the share that the line loses.
        """
        if now - listened <= self._heard_at:
            return False  # it gave a sign of life meanwhile
        self._is_settled = False
        self._streak += 1
        self._listened += listened
        self._flapping = flapping
        self._longest = longest_silence(max(loss, share_lost(*self.loss.counts, loss)))
        return self._streak > self._longest

    def missed(self, now: float, limit: int) -> bool:
        """A request ended without an answer. True if the unit is offline from now on: for that, `limit` in a row must
        have ended so at least."""
        self._requests += 1
        if self.offline or self._requests < limit or self._streak <= self._longest:
            return False
        flaps, self._silent_at = self.flaps(now), now
        self.offline = True
        self.probe_at = now + (self._listened * max(1, self._flapping) / SHARE if flaps else 0.0)
        self.probed_at = now
        return True
