"""What a state of the owner is, as a number: two states that behave alike have the same one.

Times count from now. What only counts or remembers for people (statistics, the flight recorder) is left out, as are
the contents of what cannot change.
"""

from __future__ import annotations

import enum
import hashlib
from collections import OrderedDict, deque
from collections.abc import Iterator
from functools import lru_cache
from types import BuiltinFunctionType, CodeType, FunctionType, GeneratorType, MethodType, ModuleType
from typing import Any

_PLAIN = (int, str, bytes, bool, type(None), enum.Enum, type, CodeType, ModuleType, BuiltinFunctionType)
_LEFT_OUT = frozenset(
    {"journal", "flight", "stats", "now", "_now", "airtime", "config", "_config", "_loop", "line", "__weakref__"}
)
_EPOCH = 500.0
"""Numbers from here on are times, in seconds; the world's clock begins at 1000."""
_STEP = 1e-5


def fingerprint(root: object, now: float) -> int:
    """The state of an object and of all it holds."""
    state = repr(list(_walk(root, now, {}))).encode()
    return int.from_bytes(hashlib.blake2b(state, digest_size=8).digest(), "big")


def _walk(thing: Any, now: float, seen: dict[int, int]) -> Iterator[Any]:
    stack = [thing]
    pop, push = stack.pop, stack.append
    while stack:
        one = pop()
        kind = one.__class__
        if kind is float:
            yield round((one - now) / _STEP) if _EPOCH < one < 1e9 else one
            continue
        if isinstance(one, _PLAIN):
            yield one if kind in (int, str, bytes, bool) or one is None else str(one)
            continue
        known = seen.get(id(one))
        if known is not None:
            yield ("again", known)
            continue
        seen[id(one)] = len(seen)
        yield kind.__name__
        if kind in (tuple, list, deque):
            yield len(one)
            stack.extend(one)
        elif kind in (dict, OrderedDict):
            yield len(one)
            for key, value in one.items():
                push(value)
                push(key)
        elif kind in (set, frozenset):
            yield tuple(sorted(map(repr, one))) if all(isinstance(each, _PLAIN) for each in one) else len(one)
        elif kind is FunctionType:
            yield one.__qualname__
            for cell in one.__closure__ or ():
                push(cell.cell_contents)
            push(one.__defaults__)
        elif kind is MethodType:
            yield one.__func__.__qualname__
            push(one.__self__)
        elif kind is GeneratorType:
            frame = one.gi_frame
            yield one.__qualname__
            if frame is not None:
                yield frame.f_lasti
                push(one.gi_yieldfrom)
                stack.extend(frame.f_locals.values())
        else:
            for name in _names(kind):
                if hasattr(one, name):
                    yield name
                    push(getattr(one, name))
            for name, value in sorted(getattr(one, "__dict__", {}).items()):
                if name not in _LEFT_OUT:
                    yield name
                    push(value)


@lru_cache(maxsize=1000)
def _names(kind: type) -> tuple[str, ...]:
    """The slots of a class and of those that it comes from."""
    return tuple(name for base in kind.__mro__ for name in getattr(base, "__slots__", ()) if name not in _LEFT_OUT)
