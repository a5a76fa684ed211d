"""What the owner knows of a thing that moves: whether it may, since when, and how often it was stopped."""

from __future__ import annotations

from collections.abc import Iterable

NEVER = float("-inf")


class Motion:
    """An axis, or a device made of several (`parts`).

    The epoch counts the stops. A job remembers the epoch it was made in and is dropped once that has passed: so
    nothing that moves and is older than a stop ever follows it onto the wire.
    """

    __slots__ = ("_commanded_at", "_leaves", "_may_move", "_stops")

    def __init__(self, parts: Iterable[Motion] = ()) -> None:
        self._leaves: tuple[Motion, ...] = tuple(leaf for part in parts for leaf in part._leaves) or (self,)
        self._stops = 0
        self._may_move = False
        self._commanded_at = NEVER

    @property
    def epoch(self) -> int:
        """Changes with every stop of this, of a part, or of the whole it is a part of."""
        return sum(leaf._stops for leaf in self._leaves)

    @property
    def may_move(self) -> bool:
        """Whether a frame that moves it was sent, and it was not seen standing since."""
        for leaf in self._leaves:  # noqa: SIM110 - asked at every reply, and `any` takes thrice as long
            if leaf._may_move:
                return True
        return False

    @property
    def commanded_at(self) -> float:
        """When the last frame that moves it was sent."""
        return max(leaf._commanded_at for leaf in self._leaves)

    def stop(self) -> None:
        """Begin a new epoch."""
        for leaf in self._leaves:
            leaf._stops += 1

    def commanded(self, now: float) -> None:
        """A frame that moves it goes out."""
        for leaf in self._leaves:
            leaf._may_move = True
            leaf._commanded_at = now

    def moves(self) -> None:
        """It was seen moving, whoever set it in motion."""
        for leaf in self._leaves:
            leaf._may_move = True

    def stands(self, seen_at: float) -> None:
        """It was seen standing, by a question asked at the time given. What was told to move since may move."""
        for leaf in self._leaves:
            leaf._may_move = leaf._may_move and leaf._commanded_at > seen_at
