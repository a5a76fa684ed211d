"""What the handles of several commands have in common."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Mapping
from typing import Any, TypeVar

from rs485bus.bus.handle import Handle
from rs485bus.errors import MoveCancelled
from rs485bus.motion.group.member import GroupMember

E = TypeVar("E", bound=BaseException)


def named(name: str | None, error: E, axes: Mapping[str, GroupMember] | None = None) -> E:
    """The same error, saying which axis it is of, and how all others are that were to move together with it."""
    others = [f"{other} {axis.condition}" for other, axis in (axes or {}).items() if other != name]
    said = str(error) if name is None else f"{name}: {error}"
    copied = copy.copy(error)
    copied.args = (f"{said} When this was told, {', '.join(others)}." if others else said,)
    copied.__cause__ = error
    return copied


def first_failure(parts: Collection[Handle[Any]]) -> Exception | None:
    """Why one of several commands failed, once all have ended; of one that was cancelled only where all were."""
    errors = [part.error for part in parts if part.error is not None]
    if not errors or not all(part.done() for part in parts):
        return None
    return min(errors, key=lambda error: isinstance(error, MoveCancelled))


def when_all_have_ended(parts: Collection[Handle[Any]], callback: Callable[[], object]) -> None:
    """Call back once, as soon as all have ended; at once where they have."""
    missing = set(parts)

    def ended(part: Handle[Any]) -> None:
        missing.discard(part)
        if not missing:
            callback()

    for part in list(missing):
        part.add_done_callback(ended)
