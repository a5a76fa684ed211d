"""A stream of set-points to a served plant."""

from __future__ import annotations

import asyncio
import contextlib
from types import TracebackType

from rs485bus.arguments import real
from rs485bus.bus.async_block import AsyncBlock
from rs485bus.errors import BusError, MotionError, MoveCancelled
from rs485bus.remote.handles import RemoteMove
from rs485bus.remote.outbox import Outbox
from rs485bus.remote.session import Session
from rs485bus.service.schema import SetPoint

_OPENING = 5.0
"""Seconds within which the service must open it."""


class RemoteStream(AsyncBlock):
    """`async with axis.stream() as setpoint: setpoint(rpm)`. The newest set-point counts. Leaving the block stops.

    Args:
        name: what it sets.
        moves: the names of the axes that this moves.
        session: the connection.
        outbox: says the verbs.
        timeout: seconds for which a set-point holds.
        values: how many numbers it has.
    """

    def __init__(
        self, name: str, moves: frozenset[str], session: Session, outbox: Outbox, timeout: float, values: int
    ) -> None:
        self._name = name
        self._moves = moves
        self._session = session
        self._outbox = outbox
        self._timeout = timeout
        self._values = values
        self._handle: RemoteMove[None] | None = None
        self._lease = 0
        self._count = 0

    def __call__(self, *values: float) -> None:
        """Set it, from now on.

        Raises:
            MotionError: the stream is over: it was stopped, or control was lost.
            TypeError: it takes another number of values, or something is no number.
        """
        if len(values) != self._values:
            raise TypeError(f"a set-point of {self._name} has {self._values} values, not {len(values)}")
        numbers = [real("set-point", value) for value in values]
        handle, session = self._handle, self._session
        if handle is None or handle.request is None:
            raise MotionError(f"The stream of {self._name} is not open: async with ... as setpoint.")
        if handle.done():
            if handle.error is not None:
                handle.seen = True
                raise handle.error
            raise MotionError(f"The stream of {self._name} is over.")
        said = SetPoint(
            stream=handle.request,
            client=session.client,
            lease=self._lease,
            sent=session.now(),
            n=self._count,
            values=numbers,
        )
        self._count += 1
        session.put(session.topics.setpoint(self._name), said)

    async def __aenter__(self) -> RemoteStream:
        """Open it.

        Raises:
            NotInControl, MotionError, NotSent: why it cannot be opened.
        """
        handle = self._outbox.verb(self._name, "stream", {"timeout": self._timeout}, self._moves)
        self._handle, self._count = handle, 0
        try:
            async with asyncio.timeout(_OPENING):
                await self._begun(handle)
        except BaseException:
            handle.seen = True
            handle.cancel()
            raise
        lease = self._outbox.lease
        assert lease is not None
        self._lease = lease
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop, and see it stand; that is so where somebody else has stopped it, too: the service says so then.

        Raises:
            StopUnconfirmed: it was not seen to stand.
            MotionError, RequestFailed: what it has failed of.
        """
        handle = self._handle
        assert handle is not None
        if not handle.done() and handle.request is not None:
            ending = self._outbox.verb(self._name, "end_stream", {"stream": handle.request}, self._moves)
            ending.seen = True
            try:
                await ending.wait()
            except BusError:
                self._outbox.stop(self._moves, everything=False).seen = True
        handle.seen = True
        if error is None:
            with contextlib.suppress(MoveCancelled):  # somebody stopped it, and it stands
                await handle.wait()

    async def _begun(self, handle: RemoteMove[None]) -> None:
        begun = asyncio.ensure_future(handle.begun.wait())
        ended = asyncio.ensure_future(handle.wait())
        try:
            await asyncio.wait((begun, ended), return_when=asyncio.FIRST_COMPLETED)
            if ended.done():
                ended.result()
        finally:
            begun.cancel()
            ended.cancel()
