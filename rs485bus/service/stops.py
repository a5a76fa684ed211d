"""Which axes were stopped, and which stops are being confirmed. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from rs485bus.errors import MoveCancelled
from rs485bus.service.decisions import Halt, Order

_NEVER = float("-inf")


class StopBook:
    """The stops of one plant."""

    def __init__(self) -> None:
        self._stopped: dict[str, tuple[float, str]] = {}
        """When each axis was last stopped, and by which request."""
        self._confirming: dict[str, Halt] = {}
        """The stops that somebody asked for and that are being confirmed, by request."""
        self._open: list[Halt] = []
        """The stops that are being confirmed and after which nothing of their axes has begun."""
        self.unsettled: frozenset[str] = frozenset()
        """The axes that nobody commands any more and that were not seen standing yet."""

    def last(self, axis: str) -> str | None:
        """The request by which an axis was last stopped, if it was one."""
        return self._stopped.get(axis, (_NEVER, ""))[1] or None

    def latest(self, axes: Iterable[str]) -> float:
        """When one of these axes was last stopped."""
        return max((self._stopped[axis][0] for axis in axes if axis in self._stopped), default=_NEVER)

    def check(self, order: Order) -> None:
        """Raise `MoveCancelled` for an order that was said before one of its axes was stopped."""
        if order.sent <= self.latest(order.axes):
            raise MoveCancelled(f"{order.name} {order.verb}: a stop came after this was said. Nothing was done.")

    def same(self, halt: Halt) -> Halt | None:
        """The stop that is being confirmed and that this one says again."""
        earlier = self._confirming.get(halt.id)
        return earlier if earlier is not None and _alike(earlier, halt) else None

    def covering(self, halt: Halt) -> Halt | None:
        """The stop that is being confirmed and does all that this one would: nothing has begun since."""
        return next((earlier for earlier in self._open if _alike(earlier, halt)), None)

    def begun(self, halt: Halt, now: float) -> None:
        """Axes are stopped."""
        self.said(halt, now)
        self._open.append(halt)
        if halt.id:
            self._confirming[halt.id] = halt

    def said(self, halt: Halt, now: float) -> None:
        """Nothing of these axes that was said before is begun any more."""
        for axis in halt.axes:
            self._stopped[axis] = (now, halt.id)

    def moved(self, axes: frozenset[str]) -> None:
        """Something has begun that moves these axes."""
        self._open = [halt for halt in self._open if not halt.axes & axes]

    def ended(self, halt: Halt, *, standing: bool) -> None:
        """They were seen to stand, or not."""
        self._open = [each for each in self._open if each is not halt]
        if self._confirming.get(halt.id) is halt:
            del self._confirming[halt.id]
        if standing:
            self.unsettled -= halt.axes


def _alike(one: Halt, other: Halt) -> bool:
    return (one.axes, one.emergency) == (other.axes, other.emergency)
