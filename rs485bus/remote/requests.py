"""Requests that are on their way, and when they are said again. Pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rs485bus.errors import NoReply, NotSent, OutcomeUnknown
from rs485bus.service.schema import Answer
from rs485bus.service.troubles import raised

AGAIN = 1.0
"""Seconds after which what was not heard of is said again: with the same id, so that it is done once."""
AGAIN_BEGUN = 5.0

Ended = Callable[[Answer | None, Exception | None], None]


@dataclass(eq=False)
class Pending:
    """A request that waits for its end."""

    id: str
    what: str
    topic: str
    make: Callable[[], bytes]
    """Makes the message, once it can be said what time it is for the service."""
    once: bool
    """It is a verb; others are questions."""
    life: float
    """Seconds until it expires."""
    ended: Ended
    told: Callable[[Answer], None] = lambda _: None
    asked: float = float("inf")
    """When it was asked for."""
    timeless: bool = False
    """It says no time: the service is asked for its own."""
    payload: bytes = b""
    first_sent: float | None = None
    last_sent: float = float("-inf")
    heard: float | None = None
    """When anything was heard of it."""


class PendingRequests:
    """Those of one client.

    Args:
        patience: seconds within which something must be heard of a request.
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self._pending: dict[str, Pending] = {}

    def __len__(self) -> int:
        return len(self._pending)

    def add(self, request: Pending) -> None:
        self._pending[request.id] = request

    def get(self, request: str) -> Pending | None:
        return self._pending.get(request)

    def sent(self, request: Pending, now: float) -> None:
        """It was said."""
        request.last_sent = now
        if request.first_sent is None:
            request.first_sent = now

    def answered(self, answer: Answer, now: float) -> None:
        """Something was heard of one."""
        request = self._pending.get(answer.id)
        if request is None:
            return
        request.heard = now
        request.told(answer)
        if answer.outcome == "begun":
            return
        del self._pending[request.id]
        request.ended(answer, None if answer.error is None else raised(answer.error))

    def refused(self, request: Pending, error: Exception) -> None:
        """The broker did not take it."""
        if self._pending.pop(request.id, None) is not None:
            request.ended(None, error)

    def drop(self, request: str) -> None:
        """Nobody waits for it any more."""
        self._pending.pop(request, None)

    def due(self, now: float, *, anew: bool = False) -> list[Pending]:
        """Those that are to be said now; `anew`: the service or the connection is a new one. Those of which nothing was
        heard for too long are ended."""
        due = []
        for request in list(self._pending.values()):
            since = next(at for at in (request.heard, request.first_sent, request.asked) if at is not None)
            if now - since > self.patience:
                del self._pending[request.id]
                request.ended(None, _nothing_heard(request, now - since))
            elif anew or now - request.last_sent >= (AGAIN if request.heard is None else AGAIN_BEGUN):
                due.append(request)
        return due

    def give_up(self, why: str) -> None:
        """The connection is being closed."""
        for request in list(self._pending.values()):
            del self._pending[request.id]
            request.ended(None, _given_up(request, why))


def _nothing_heard(request: Pending, seconds: float) -> Exception:
    if request.first_sent is None:
        return NotSent(f"{request.what}: there was no connection for {seconds:.1f} s. Nothing was done.")
    said = f"{request.what}: nothing was heard of it for {seconds:.1f} s"
    if not request.once:
        return NoReply(f"{said}. Does the service run, and may it answer?")
    return OutcomeUnknown(f"{said}: nobody knows whether it was done. Read where the axis is before it is said again.")


def _given_up(request: Pending, why: str) -> Exception:
    if request.first_sent is None:
        return NotSent(f"{request.what}: {why} Nothing was done.")
    return OutcomeUnknown(f"{request.what}: {why} Nobody knows whether it was done.")
