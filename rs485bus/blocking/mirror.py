"""The blocking face of a class, made from the class itself: the same names, called in the loop's thread and waited for.

A method that commands returns its handle's face, a coroutine its result, an asynchronous iterator an iterator, and an
asynchronous context manager a context manager. Signatures and docstrings are those of the class, so that neither can
drift; what type checkers read is `__init__.pyi`, which a test holds against the same classes.
"""

from __future__ import annotations

import functools
import inspect
import weakref
from collections.abc import Callable, Iterable, Iterator
from types import FunctionType, GenericAlias, MappingProxyType, MethodType
from typing import Any

from rs485bus.blocking.block import BlockFace
from rs485bus.blocking.display import show_status
from rs485bus.blocking.loop import LoopThread
from rs485bus.blocking.waiting import wait

_OURS = "rs485bus."
_GIVEN = ("rs485bus.transport.", "rs485bus.sim.")
"""What is given to a bus, and never comes from one."""
_AWAITED = ("__await__", "__aenter__", "__aiter__")
_SPECIAL = ("__call__", "__contains__", "__getitem__", "__len__")
_PLAIN = (type(None), bool, int, float, str, bytes)

HIDDEN = frozenset(
    {
        # What other layers call, and users do not. Newer classes say so by their `__dir__`.
        *(
            "abandon",
            "attach",
            "attached",
            "check_ready",
            "check_thread",
            "forgive",
            "join",
            "left_alone",
            "member",
            "motion",
        ),
        *("target_range", "finish", "fail", "drop", "hold", "taken_along", "unconfirmed"),
        *("released", "order_together", "pair", "carries_out", "ask", "submit", "start", "halt", "heard_after", "now"),
        *("after_stops", "spawn", "call_at", "keep", "poke", "after", "unseen", "received"),
        *("owner", "loop", "thread", "devices"),
        *("open", "aclose", "adjust", "share_time", "check_open", "interrupted"),
        *("replace", "on_end", "over", "check", "end"),
        *("tells_restarts", "told_standing", "driver", "modes", "link"),
    }
)


class Face:
    """The blocking face of something that lives in the loop's thread."""

    _inner: Any
    _loop: LoopThread
    _source: object
    """Where it came from, which lives as long as this does."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        source = next((given for given in (*arguments, *keywords.values()) if isinstance(given, Face)), None)
        if source is None:
            raise TypeError(f"{type(self).__name__}() needs a bus of rs485bus.blocking, or an axis of one")
        inner = source._new(_MADE_FROM[type(self)], source._inner_of(arguments), source._inner_of(keywords))
        self._adopt(inner, source._loop, source)

    def _new(self, cls: type, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
        """An instance of a class, made on the bus that this came from."""
        assert isinstance(self._source, Face)
        return self._source._new(cls, arguments, keywords)

    def _adopt(self, inner: Any, loop: LoopThread, source: object) -> None:
        """Be the face of `inner` from now on."""
        for name, value in (("_inner", inner), ("_loop", loop), ("_source", source)):
            object.__setattr__(self, name, value)
        _faces[id(inner)] = self

    def __repr__(self) -> str:
        return repr(self._inner)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *filter(_public, dir(self._inner))})

    def __getattr__(self, name: str) -> Any:
        if not _public(name):
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")
        return self._answer(getattr(self._inner, name))

    def __setattr__(self, name: str, value: Any) -> None:
        if name.startswith("_"):
            object.__setattr__(self, name, value)
        elif not _public(name) or not hasattr(self._inner, name):
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r} that could be set")
        else:
            self._call(setattr, self._inner, name, value)

    def _call(self, function: Callable[..., Any], /, *arguments: Any, **keywords: Any) -> Any:
        return self._answer(self._loop.call(function, *self._inner_of(arguments), **self._inner_of(keywords)))

    def _answer(self, value: Any) -> Any:
        """What stands for a value that came from the loop's thread: the value itself, unless it lives there."""
        kind = type(value)
        if kind in _PLAIN:
            return value
        if lives(kind):
            face = _faces.get(id(value))
            return face if face is not None and face._inner is value else self._of(face_class(kind), value)
        if kind in (list, tuple):
            return kind(map(self._answer, value))
        if kind in (dict, MappingProxyType):
            return {key: self._answer(item) for key, item in value.items()}
        if hasattr(kind, "__anext__"):
            return Stream(value, self)
        if hasattr(kind, "__aenter__"):
            return self._of(Context, value)
        if kind in (FunctionType, MethodType):
            return functools.wraps(value)(functools.partial(self._call, value))
        return value

    def _inner_of(self, value: Any) -> Any:
        """What stands for a value in the loop's thread. A function is called there, and is given faces."""
        kind = type(value)
        if kind in _PLAIN:
            return value
        if isinstance(value, Face):
            return value._inner
        if kind in (list, tuple):
            return kind(map(self._inner_of, value))
        if kind is dict:
            return {key: self._inner_of(item) for key, item in value.items()}
        if kind in (FunctionType, MethodType):
            return lambda *given: self._inner_of(value(*map(self._answer, given)))
        return value

    def _of(self, face: type[Face], inner: Any) -> Face:
        made = face.__new__(face)
        made._adopt(inner, self._loop, self)
        return made


_faces: weakref.WeakValueDictionary[int, Face] = weakref.WeakValueDictionary()
"""By the identity of what they are the face of."""
_MADE_FROM: dict[type, type] = {}
_OF: dict[type, type] = {}
"""The face of each class, once it was asked for."""


def face_class(cls: type) -> type[Face]:
    """The blocking face of a class."""
    face = _OF.get(cls)
    if face is None:
        bases: tuple[type, ...] = tuple(face_class(base) for base in cls.__bases__ if lives(base)) or (Face,)
        members = {name: member for name in offered(cls) if (member := _member(cls, name)) is not None}
        members |= {"__doc__": cls.__doc__, "__module__": "rs485bus.blocking"}
        if hasattr(cls, "__aenter__") and not issubclass(bases[0], BlockFace):
            bases = (*bases, BlockFace)
        if hasattr(cls, "__aiter__"):
            members["__iter__"] = lambda self: self._call(self._inner.__aiter__)
        if "Generic" in {base.__name__ for base in cls.__bases__}:
            members["__class_getitem__"] = classmethod(GenericAlias)
        if hasattr(cls, "status"):
            members["_repr_html_"] = show_status
        face = type(cls.__name__, bases, members)
        register(cls, face)
    return face


def face_named(name: str, roots: Iterable[type]) -> type[Face] | None:
    """The face that is called `name`: of some classes, their bases, and what was seen of them."""
    for root in roots:
        if lives(root):
            face_class(root)
    return next((face for face in _MADE_FROM if face.__name__ == name), None)


def register(cls: type, face: type) -> None:
    """`face` is the face of `cls`."""
    _OF[cls] = face
    _MADE_FROM[face] = cls


def lives(cls: type[Any]) -> bool:
    """Whether instances of a class live in the loop's thread: whether anything of it is to be awaited."""
    known = _lives.get(cls)
    if known is None:
        known = _lives[cls] = _is_awaited(cls)
    return known


_lives: dict[type[Any], bool] = {}


def _is_awaited(cls: type[Any]) -> bool:
    if not cls.__module__.startswith(_OURS) or cls.__module__.startswith(_GIVEN) or issubclass(cls, BaseException):
        return False
    if getattr(cls, "_is_protocol", False):
        return False
    if any(lives(base) for base in cls.__bases__):
        return True
    return any(name in vars(cls) for name in _AWAITED) or any(
        inspect.iscoroutinefunction(member) or inspect.isasyncgenfunction(member) for member in vars(cls).values()
    )


class Stream(Iterator[Any]):
    """The blocking face of an asynchronous iterator. `close()` ends it; so does letting go of it, by asyncio."""

    _END = object()

    def __init__(self, inner: Any, source: Face) -> None:
        self._inner = inner
        self._source = source

    def __next__(self) -> Any:
        value = self._source._loop.call(self._step)
        if value is self._END:
            raise StopIteration
        return self._source._answer(value)

    def close(self) -> None:
        """End it: whatever it asks for is asked no more."""
        self._source._loop.call(self._end)

    async def _step(self) -> Any:
        try:
            return await self._inner.__anext__()
        except StopAsyncIteration:
            return self._END

    async def _end(self) -> None:
        if hasattr(self._inner, "aclose"):
            await self._inner.aclose()


class Context(Face, BlockFace):
    """The blocking face of an asynchronous context manager of no class of ours."""


def _public(name: str) -> bool:
    return not name.startswith("_") and name not in HIDDEN


def offered(cls: type) -> list[str]:
    """What users call of a class that the faces of its bases do not have."""
    own = [base for base in cls.__mro__ if base is cls or (base.__module__.startswith(_OURS) and not lives(base))]
    try:
        offered = set(object.__new__(cls).__dir__())
    except Exception:  # it is abstract, or depends on what an instance holds
        offered = set(dir(cls))
    return [
        name
        for name in sorted({name for base in own for name in vars(base)})
        if name in _SPECIAL or (_public(name) and name in offered)
    ]


def _member(cls: type, name: str) -> Any:
    """The face of a method, a property or a constant of a class."""
    member = inspect.getattr_static(cls, name)
    if name == "wait" and hasattr(cls, "__await__"):
        return wait
    if isinstance(member, property):
        return property(lambda self: self._call(getattr, self._inner, name), doc=member.__doc__)
    if isinstance(member, FunctionType):

        @functools.wraps(member)
        def method(self: Face, *arguments: Any, **keywords: Any) -> Any:
            return self._call(getattr(self._inner, name), *arguments, **keywords)

        return method
    return member if isinstance(member, _PLAIN) else None
