"""Who commands which axes. Pure."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from rs485bus.errors import NotInControl
from rs485bus.service.schema import Holding


def _draw() -> int:
    return 1 + secrets.randbelow(2**48)


@dataclass(eq=False)
class Lease:
    """One client commands some axes, as long as it shows that it is there."""

    number: int
    """Drawn at random: it can neither be guessed, nor is it that of an earlier lease."""
    client: str
    seconds: float
    until: float
    axes: set[str] = field(default_factory=set)
    asked: set[str] = field(default_factory=set)
    """The requests by which it was taken."""

    def seen(self, sent: float, now: float) -> None:
        """The client was there when it sent this: not when it came in."""
        self.until = max(self.until, min(sent, now) + self.seconds)

    def told(self) -> dict[str, Any]:
        """As the client is told it."""
        holding = Holding(
            lease=self.number, client=self.client, axes=sorted(self.axes), until=self.until, seconds=self.seconds
        )
        return holding.model_dump()


class LeaseBook:
    """The leases. An axis has one at most, and so has a client.

    Args:
        draw: makes the number of a lease.
    """

    def __init__(self, draw: Callable[[], int] = _draw) -> None:
        self._draw = draw
        self._leases: dict[int, Lease] = {}
        self._holders: dict[str, Lease] = {}

    def __iter__(self) -> Iterator[Lease]:
        return iter(self._leases.values())

    def holder(self, axis: str) -> str | None:
        """Who commands an axis."""
        lease = self._holders.get(axis)
        return None if lease is None else lease.client

    def of(self, client: str) -> Lease | None:
        """The lease of a client."""
        return next((lease for lease in self if lease.client == client), None)

    def get(self, number: int | None, client: str) -> Lease | None:
        """The lease of a number, if it is this client's."""
        lease = None if number is None else self._leases.get(number)
        return lease if lease is not None and lease.client == client else None

    def check(self, number: int | None, client: str, axes: Iterable[str], what: str) -> Lease:
        """The lease of a number, if it covers the axes.

        Raises:
            NotInControl: it does not; the message says who has what is missing.
        """
        lease = self.get(number, client)
        missing = sorted(axis for axis in axes if lease is None or axis not in lease.axes)
        if lease is not None and not missing:
            return lease
        said = "names no lease" if number is None else "names a lease that has ended" if lease is None else ""
        others = {axis: other for axis in missing if (other := self.holder(axis)) not in (None, client)}
        if others:
            said = ", ".join(f"{axis} is commanded by {other}" for axis, other in others.items())
        elif not said:
            said = f"its lease does not cover {', '.join(missing)}"
        raise NotInControl(f"{what}: {said}. Nothing was done. Take control first, and show presence to keep it.")

    def check_free(self, client: str, axes: Iterable[str]) -> None:
        """Raise `NotInControl` where another client commands one of these axes."""
        others = {axis: other for axis in sorted(axes) if (other := self.holder(axis)) not in (None, client)}
        if others:
            raise NotInControl(
                f"{', '.join(f'{axis} is commanded by {other}' for axis, other in others.items())}: one client at a "
                "time. Nothing was done. Wait until that one leaves. Stops need no lease."
            )

    def take(self, client: str, axes: Iterable[str], seconds: float, number: int | None) -> Lease:
        """Have a client command axes that are free, besides those that it commands already by this number."""
        lease = self.get(number, client)
        if lease is None:
            lease = Lease(self._draw(), client, seconds, float("-inf"))
            self._leases[lease.number] = lease
        lease.seconds = seconds
        lease.axes.update(axes)
        self._holders.update(dict.fromkeys(lease.axes, lease))
        return lease

    def end(self, lease: Lease) -> None:
        """It is over."""
        self._leases.pop(lease.number, None)
        for axis in lease.axes:
            self._holders.pop(axis, None)

    @property
    def first_end(self) -> float:
        """When the next one ends, if its client is silent."""
        return min((lease.until for lease in self), default=float("inf"))
