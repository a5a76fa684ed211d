"""What a slave may hold by now: after an answer one value, after an unknown outcome or a restart one of several."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

Place = tuple[str, int]

INITIAL: dict[str, Callable[[int], int]] = {
    "coil": lambda at: at % 3 == 0,
    "input": lambda at: at % 2 == 0,
    "register": lambda at: 500 + at,
    "input register": lambda at: 900 + at,
}
SIZE = 64


class Memory:
    """The slave's memory as far as it is known. Every place has one writer."""

    def __init__(self) -> None:
        self._possible = {(kind, at): {make(at)} for kind, make in INITIAL.items() for at in range(SIZE)}
        self.restarts = 0
        self._restarting = False

    @contextmanager
    def restarting(self) -> Iterator[None]:
        """It is restarted within the block: whatever it held, from some moment on it holds what it held at first."""
        self._restarting = True
        self._as_at_first()
        try:
            yield
        finally:
            self._as_at_first()
            self._restarting = False

    def _as_at_first(self) -> None:
        self.restarts += 1
        for (kind, at), values in self._possible.items():
            values.add(INITIAL[kind](at))

    def is_sure(self, restarts: int) -> bool:
        """Whether it was not restarted since it had been so often, nor is being so."""
        return restarts == self.restarts and not self._restarting

    def writing(self, kind: str, first: int, news: Sequence[Callable[[int], int]]) -> Writing:
        """Begin to write: `news` make the new values of the old ones."""
        return Writing(self._possible, [(kind, first + offset) for offset in range(len(news))], news)

    def read(self, kind: str, first: int, values: Sequence[int], restarts: int) -> int:
        """How many of some values cannot be. They are what it holds, unless it was restarted since `restarts`."""
        wrong = 0
        for at, value in enumerate(values, first):
            wrong += value not in self._possible[kind, at]
            if self.is_sure(restarts):
                self._possible[kind, at] = {value}
        return wrong


class Writing:
    """A write on its way."""

    def __init__(
        self, possible: dict[Place, set[int]], places: list[Place], news: Sequence[Callable[[int], int]]
    ) -> None:
        self._possible = possible
        self._places = places
        self._news = news
        self._before = [set(possible[place]) for place in places]
        self._after = [{new(value) for value in possible[place]} for place, new in zip(places, news, strict=True)]
        self.unknown()

    def unknown(self) -> None:
        """It may have been done, to what the slave held before or to what it held after a restart."""
        for place, new in zip(self._places, self._news, strict=True):
            self._possible[place] |= {new(value) for value in self._possible[place]}

    def done(self, sure: bool) -> None:
        """It was done; a restart may have undone it."""
        if not sure:
            self.unknown()
        else:
            for place, after in zip(self._places, self._after, strict=True):
                self._possible[place] = set(after)

    def not_done(self, sure: bool) -> None:
        """It was not done."""
        if sure:
            for place, before in zip(self._places, self._before, strict=True):
                self._possible[place] = set(before)
