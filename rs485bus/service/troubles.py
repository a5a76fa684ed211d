"""Exceptions as JSON, and back: the same names on both sides."""

from __future__ import annotations

import inspect
from typing import Literal

from rs485bus import errors
from rs485bus.errors import BusError, NotSent, OutcomeUnknown, RequestFailed, RequestMalformed
from rs485bus.service.schema import Trouble

_TOLD = (TypeError, ValueError)
_KNOWN: dict[str, type[Exception]] = {
    **{name: kind for name, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, BusError)},
    **{kind.__name__: kind for kind in _TOLD},
}

Ending = Literal["refused", "failed", "unknown"]


def trouble(error: BaseException) -> Trouble:
    """An exception, for somebody elsewhere."""
    told = error if isinstance(error, (BusError, *_TOLD)) else BusError(f"{type(error).__name__}: {error}")
    if not isinstance(error, RequestFailed):
        return Trouble(type=_name(told), message=str(told))
    return Trouble(
        type=_name(told),
        message=str(error),
        address=error.address or None,
        attempts=error.attempts or None,
        code=error.code,
        request=error.request.hex() or None,
    )


def raised(told: Trouble) -> Exception:
    """The exception that somebody elsewhere told of."""
    kind = _KNOWN.get(told.type, BusError)
    if issubclass(kind, RequestFailed):
        return kind(
            told.message,
            address=told.address or 0,
            request=_frame(told.request or ""),
            attempts=told.attempts or 0,
            code=told.code,
        )
    return kind(told.message)


def _frame(digits: str) -> bytes:
    try:
        return bytes.fromhex(digits)
    except ValueError:  # whoever said that is not to be relied on; what became of the request is told all the same
        return b""


def ending(error: BaseException, *, begun: bool) -> Ending:
    """What became of a request that ended with this error."""
    if isinstance(error, OutcomeUnknown):
        return "unknown"
    if not begun or isinstance(error, NotSent | RequestMalformed):
        return "refused"
    return "failed"


def _name(error: BaseException) -> str:
    """The nearest name that the other side knows."""
    return next((kind.__name__ for kind in type(error).__mro__ if kind.__name__ in _KNOWN), "BusError")
