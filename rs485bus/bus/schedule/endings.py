"""Several procedures that one waits for. Pure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Endings(Generic[T]):
    """What a number of procedures returned, once all of them have. A procedure may yield it to wait for that.

    Args:
        count: how many.
    """

    def __init__(self, count: int) -> None:
        self._results: list[T | None] = [None] * count
        self._missing = count
        self._listeners: list[Callable[[list[T]], None]] = []

    @property
    def told(self) -> list[T] | None:
        """The results, in the order of the procedures; None while one is missing."""
        return None if self._missing else self._results  # type: ignore[return-value] # all of them are there

    def ending(self, place: int) -> Callable[[T], None]:
        """To be called with the result of one of them."""

        def ended(result: T) -> None:
            self._results[place] = result
            self._missing -= 1
            results = self.told
            if results is not None:
                for listener in self._listeners:
                    listener(results)

        return ended

    def listen(self, listener: Callable[[list[T]], None]) -> None:
        """Be told the results. Not to be called where they are there already."""
        self._listeners.append(listener)
