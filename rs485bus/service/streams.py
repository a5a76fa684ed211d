"""The streams of set-points that are open. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.service.schema import SetPoint


@dataclass(eq=False)
class OpenStream:
    """One stream, and what became of its set-points."""

    id: str
    name: str
    timeout: float
    newest: int = -1
    taken: int = 0
    stale: int = 0
    """Older than the timeout when they came in, by their own time stamp, or older than a stop."""
    overtaken: int = 0
    """A newer one came in before."""


class StreamBook:
    """The streams, by what they set: an axis or a vehicle has one at most."""

    def __init__(self) -> None:
        self._open: dict[str, OpenStream] = {}

    def open(self, stream: str, name: str, timeout: float) -> None:
        """A stream begins. It takes the place of an earlier one."""
        self._open[name] = OpenStream(stream, name, timeout)

    def close(self, request: str) -> None:
        """A request, of a stream perhaps, has ended."""
        for name, stream in list(self._open.items()):
            if stream.id == request:
                del self._open[name]

    def get(self, name: str) -> OpenStream | None:
        return self._open.get(name)

    def accept(self, name: str, said: SetPoint, now: float, *, held: bool, stopped: float) -> float | None:
        """Until when a set-point holds; None for one that must not be used.

        Args:
            name: what it is for.
            said: the set-point.
            now: the time.
            held: whether its lease covers the axes.
            stopped: when one of them was last stopped.
        """
        stream = self._open.get(name)
        if stream is None or stream.id != said.stream or not held:
            return None
        if said.n <= stream.newest:
            stream.overtaken += 1
            return None
        until = min(said.sent, now) + stream.timeout
        if until <= now or said.sent <= stopped:
            stream.stale += 1
            return None
        stream.newest = said.n
        stream.taken += 1
        return until
