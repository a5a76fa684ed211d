"""What the handles of several commands have in common."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from rs485bus.bus.handle import Handle
from rs485bus.errors import MoveCancelled


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
