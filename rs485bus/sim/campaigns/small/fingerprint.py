"""What a state of the owner is, as a number: two states that behave alike have the same one.

Times count from now. What only counts or remembers for people (statistics, the flight recorder) is left out, as are
the contents of what cannot change.
"""

from __future__ import annotations

import enum
import hashlib
import marshal
import operator
from collections import OrderedDict, deque
from collections.abc import Callable
from functools import lru_cache
from types import BuiltinFunctionType, CodeType, FunctionType, GeneratorType, MethodType, ModuleType
from typing import Any

from rs485bus.wire.frames import Request

_PLAIN = frozenset({int, str, bytes, bool, type(None)})
_NAMED = (enum.Enum, type, CodeType, ModuleType, BuiltinFunctionType)
_LEFT_OUT = frozenset(
    {"journal", "flight", "stats", "now", "_now", "airtime", "config", "_config", "_loop", "line", "__weakref__"}
)
_EPOCH = 500.0
"""Numbers from here on are times, in seconds; the world's clock begins at 1000."""
_STEP = 1e-5
_NO_REFERENCES = 2
"""The version of `marshal` that writes equal things alike, however often each is referred to."""

Parts = tuple[str, tuple[str, ...], Callable[[Any], Any] | None]
"""Of a class: its name, its slots, and what reads them all at once."""


def fingerprint(root: object, now: float) -> int:
    """The state of an object and of all it holds."""
    state = marshal.dumps(_walk(root, now), _NO_REFERENCES)
    return int.from_bytes(hashlib.blake2b(state, digest_size=8).digest(), "big")


def _walk(root: object, now: float) -> list[Any]:
    """All that it holds, one after the other, as plain values."""
    found: list[Any] = []
    tell, seen, stack = found.append, dict[int, int](), [root]
    pop, push = stack.pop, stack.append
    while stack:
        one: Any = pop()
        kind = one.__class__
        if kind in _PLAIN:
            tell(one)
            continue
        if kind is float:
            tell(round((one - now) / _STEP) if _EPOCH < one < 1e9 else one)
            continue
        if kind is Request:
            tell(one.adu)
            continue
        known = seen.get(id(one))
        if known is not None:
            tell((known,))
            continue
        if isinstance(one, _NAMED):
            tell(str(one))
            continue
        seen[id(one)] = len(seen)
        if kind in (tuple, list, deque):
            tell(len(one))
            stack.extend(one)
        elif kind in (dict, OrderedDict):
            tell(len(one))
            stack.extend(one.keys())
            stack.extend(one.values())
        elif kind in (set, frozenset):
            plain = all(each.__class__ in _PLAIN or isinstance(each, _NAMED) for each in one)
            tell(tuple(sorted(map(repr, one))) if plain else len(one))
        elif kind is FunctionType:
            tell(one.__qualname__)
            stack.extend(cell.cell_contents for cell in one.__closure__ or ())
            push(one.__defaults__)
        elif kind is MethodType:
            tell(one.__func__.__qualname__)
            push(one.__self__)
        elif kind is GeneratorType:
            tell(one.__qualname__)
            if one.gi_frame is not None:
                tell(one.gi_frame.f_lasti)
                push(one.gi_yieldfrom)
                stack.extend(one.gi_frame.f_locals.values())
        else:
            _open(one, kind, tell, stack)
    return found


def _open(one: Any, kind: type, tell: Callable[[Any], None], stack: list[Any]) -> None:
    """Go on with what an object holds."""
    name, slots, read = _parts(kind)
    tell(name)
    if read is not None:
        try:
            stack.extend(read(one))
        except AttributeError:  # not all of them are set
            for slot in slots:
                if hasattr(one, slot):
                    tell(slot)
                    stack.append(getattr(one, slot))
    for attribute, value in sorted(getattr(one, "__dict__", {}).items()):
        if attribute not in _LEFT_OUT:
            tell(attribute)
            stack.append(value)


@lru_cache(maxsize=1000)
def _parts(kind: type) -> Parts:
    """The slots of a class and of those that it comes from."""
    every = (getattr(base, "__slots__", ()) for base in kind.__mro__)
    split = ((names,) if isinstance(names, str) else names for names in every)
    slots = tuple(_mangled(name, kind) for names in split for name in names if name not in _LEFT_OUT)
    if not slots:
        return kind.__name__, (), None
    read = operator.attrgetter(*slots)
    return kind.__name__, slots, read if len(slots) > 1 else lambda one: (read(one),)


def _mangled(name: str, kind: type) -> str:
    """A slot's name as it is stored."""
    if not name.startswith("__"):
        return name
    owner = next(base for base in kind.__mro__ if name in getattr(base, "__slots__", ()))
    return f"_{owner.__name__.lstrip('_')}{name}"
