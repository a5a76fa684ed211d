"""Jogging by keys: a held key turns the motor, and one that is let go stops it. Pure: keys and times come in, speeds go
out.

A terminal does not tell that a key was let go. It repeats a held one, after a pause that is longer for the first
repetition. So a key counts as held for `FIRST` seconds, and once it repeats, for `AGAIN` seconds after each time.
"""

from __future__ import annotations

from dataclasses import dataclass

FIRST = 0.55
AGAIN = 0.2
_FASTER = 1.25
_SLOWEST = 1.0
_STILL = 1.0
"""rpm below which it says that the axis stands."""
_AT_A_LIMIT = 0.01
"""How near to a limit it stops at the most, as a share of the way between the limits."""
_QUIT, _ENABLE = "q", "e"
_FORWARD, _BACKWARD = ("right", "l", "d", "+"), ("left", "h", "a", "-")
_UP, _DOWN = ("up", "k", "w"), ("down", "j", "s")
_SEQUENCES = {
    "\x1b[C": "right",
    "\x1b[D": "left",
    "\x1b[A": "up",
    "\x1b[B": "down",
    "\x1bOC": "right",
    "\x1bOD": "left",
    "\x1bOA": "up",
    "\x1bOB": "down",
}


def keys_in(text: str) -> list[str]:
    """The keys that a terminal sent: arrows by name, "esc", others as they are."""
    found = []
    at = 0
    while at < len(text):
        sequence = _SEQUENCES.get(text[at : at + 3])
        if sequence is not None:
            found.append(sequence)
            at += 3
            continue
        found.append("esc" if text[at] == "\x1b" else text[at])
        at += 1
    return found


@dataclass(slots=True)
class Jog:
    """What the keys mean at each moment.

    Args:
        rpm: the speed while a key is held.
        fastest: the highest one.
    """

    rpm: float
    fastest: float
    quits: bool = False
    wants_enable: bool = False
    _direction: int = 0
    _until: float = float("-inf")

    def key(self, key: str, now: float) -> None:
        """A key came."""
        if key in _FORWARD or key in _BACKWARD:
            direction = 1 if key in _FORWARD else -1
            repeats = direction == self._direction and now < self._until
            self._direction, self._until = direction, now + (AGAIN if repeats else FIRST)
        elif key in _UP:
            self.rpm = min(self.fastest, self.rpm * _FASTER)
        elif key in _DOWN:
            self.rpm = max(_SLOWEST, self.rpm / _FASTER)
        elif key == _ENABLE:
            self._direction, self.wants_enable = 0, True
        elif key in (_QUIT, "esc", "\x03"):
            self._direction, self.quits = 0, True
        else:  # the space bar, and whatever was hit in haste
            self._direction = 0

    def state(self, asked: float, actual: float, position: float, limits: tuple[float, float] | None, unit: str) -> str:
        """What the axis does, in words.

        Args:
            asked: the set-point, in rpm.
            actual: its speed, in rpm.
            position: where it is, in its units.
            limits: lowest and highest position, in its units; None for no limits.
            unit: what its units are called.
        """
        if abs(actual) >= _STILL:
            return "turns" if asked else "stops"
        if asked and limits is not None:
            limit = limits[asked > 0]
            left = limit - position if asked > 0 else position - limit
            if left <= _AT_A_LIMIT * (limits[1] - limits[0]):
                return f"at its limit, {limit:g} {unit}: is it homed?"
        return "begins to turn" if asked else "stands"

    def speed(self, now: float) -> float:
        """The set-point, in rpm."""
        if now >= self._until:
            self._direction = 0
        return self._direction * self.rpm
