"""Arguments as users give them: checked where they come in, before anything is queued or sent.

What is of a wrong type is a `TypeError`, what is out of its range a `LimitExceeded` (a `ValueError`); both name the
argument, what is allowed, and what was given. What is returned is plain Python: a scalar of numpy may be given wherever
a number may, but reckons in its own few bits, and would overflow or round where it is used.
"""

from __future__ import annotations

import enum
import math
import operator
from collections.abc import Callable, Iterable
from typing import Any, SupportsFloat, SupportsIndex, TypeVar

from rs485bus.errors import LimitExceeded

E = TypeVar("E", bound=enum.Enum)
F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")


def whole(name: str, value: SupportsIndex, low: int, high: int | None = None) -> int:
    """A whole number in `low`..`high`; None for no end. A bool is none, though Python takes it for 0 or 1."""
    if type(value) is int:
        number = value
    else:
        try:
            if _is_truth(value):
                raise TypeError
            number = operator.index(value)
        except TypeError:
            allowed = f"in {low}..{high}" if high is not None else f"from {low} on"
            raise TypeError(f"{name} must be a whole number {allowed}, not {value!r}") from None
    if number < low or (high is not None and number > high):
        raise LimitExceeded(f"{name} {number} is " + (f"below {low}" if high is None else f"outside {low}..{high}"))
    return number


def real(name: str, value: SupportsFloat | SupportsIndex, allowed: str = "a number") -> float:
    """A number, which may be infinite. Text is none, though `float` reads it, nor is a bool."""
    if isinstance(value, float):
        number = float(value)
    else:
        try:
            if isinstance(value, str | bytes | bytearray) or _is_truth(value):
                raise TypeError
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            raise TypeError(f"{name} must be {allowed}, not {value!r}") from None
    if math.isnan(number):
        raise LimitExceeded(f"{name} must be {allowed}, not {value!r}")
    return number


def _is_truth(value: object) -> bool:
    """Whether it is True or False, of Python or of numpy, which says so by the type of its data."""
    return isinstance(value, bool) or str(getattr(value, "dtype", "")) == "bool"


def finite(name: str, value: SupportsFloat | SupportsIndex) -> float:
    """A finite number."""
    number = real(name, value, "a finite number")
    if math.isinf(number):
        raise LimitExceeded(f"{name} must be a finite number, not {number:g}")
    return number


def positive(name: str, value: SupportsFloat | SupportsIndex, unless: str = "") -> float:
    """A finite number above 0; `unless` says what to do instead of giving a negative one."""
    allowed = "a finite number above 0"
    number = real(name, value, allowed)
    if not 0 < number < math.inf:
        raise LimitExceeded(f"{name} must be {allowed}, not {number:g}{unless if number < 0 else ''}")
    return number


def rate(name: str, value: SupportsFloat | SupportsIndex) -> float:
    """A ramp: a number above 0; infinity for a jump."""
    number = real(name, value, "a number above 0, or infinity for a jump")
    if number <= 0:
        raise LimitExceeded(f"{name} must be above 0, or infinity for a jump, not {number:g}")
    return number


def flag(name: str, value: bool) -> bool:
    """True or False; 1 or 0 will do."""
    try:
        known = value in (True, False)
    except ValueError:  # an array compares each of its parts
        known = False
    if not known:
        raise TypeError(f"{name} must be True or False, not {value!r}")
    return bool(value)


def pair(name: str, value: Iterable[T], what: str) -> tuple[T, T]:
    """Two of something."""
    try:
        if isinstance(value, str):
            raise TypeError
        first, second = value
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be {what}, not {value!r}") from None
    return first, second


def choice(name: str, value: object, kind: type[E]) -> E:
    """A member of an enumeration; the value that it stands for will do."""
    if isinstance(value, kind):
        return value
    try:
        if _is_truth(value):
            raise ValueError
        return kind(value)
    except ValueError:
        members = ", ".join(f"{member.name} ({member.value})" for member in kind)
        raise LimitExceeded(f"{name} {value!r} is none of {members} of {kind.__name__}") from None


def instance(name: str, value: T, kinds: type | tuple[type, ...], example: str) -> T:
    """An object of one of some classes, as `example` makes one."""
    if not isinstance(value, kinds):
        raise TypeError(f"{name} must be made like {example}, not {value!r}{elsewhere(value)}")
    return value


def function(name: str, value: F) -> F:
    """Something that can be called."""
    if not callable(value):
        raise TypeError(f"{name} must be a function, not {value!r}")
    return value


def elsewhere(value: object) -> str:
    """What a message about a wrong object adds where it is of the blocking face: what it is to be given to."""
    if not type(value).__module__.startswith("rs485bus.blocking"):
        return ""
    return (
        ". That is of rs485bus.blocking: make what takes it there, too (bus.mks(1), bus.group(x=x), bus.vehicle(base))"
    )
