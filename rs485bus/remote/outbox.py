"""Verbs in the order in which they were said: each is sent once it is covered by the lease."""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import dataclass
from typing import Any

from rs485bus.bus.handle import Handle, start_task
from rs485bus.errors import BusError, MoveCancelled
from rs485bus.remote.control import Control
from rs485bus.remote.handles import RemoteMove
from rs485bus.remote.session import Session, new_id
from rs485bus.service.schema import Stop
from rs485bus.service.topics import PLANT


@dataclass(eq=False)
class _Wanted:
    handle: RemoteMove[Any]
    axes: frozenset[str]
    covered: frozenset[str]
    name: str
    verb: str
    arguments: dict[str, Any]
    at: float | None


class Outbox:
    """What one client says.

    Args:
        session: its connection.
        control: its lease.
        life: seconds within which a verb must be begun.
    """

    def __init__(self, session: Session, control: Control, life: float) -> None:
        self._session = session
        self._control = control
        self._life = life
        self._waiting: deque[_Wanted] = deque()
        self._work: asyncio.Task[None] | None = None
        self._under_way: set[Handle[Any]] = set()
        self._stops: dict[str, Handle[Any]] = {}
        self._unseen: list[Handle[Any]] = []

    @property
    def lease(self) -> int | None:
        """The number of the lease, while there is one."""
        return self._control.number

    def verb(
        self,
        name: str,
        verb: str,
        arguments: dict[str, Any],
        axes: frozenset[str],
        *,
        covered: frozenset[str] | None = None,
        at: float | None = None,
        position: Any = None,
    ) -> RemoteMove[Any]:
        """Say a verb. It acts when it is called, whether it is awaited or not."""
        what = f"{verb} of {name}" if name != PLANT else verb
        handle: RemoteMove[Any] = RemoteMove(what, self._cancel, position, self._unseen.append)
        handle.add_done_callback(self._under_way.discard)
        self._under_way.add(handle)
        given = {key: value for key, value in arguments.items() if value is not None}
        self._waiting.append(_Wanted(handle, axes, axes if covered is None else covered, name, verb, given, at))
        if self._work is None:
            self._work = start_task(self._send(), "rs485bus outbox")
        return handle

    def stop(self, axes: frozenset[str], *, everything: bool, emergency: bool = False) -> Handle[list[str]]:
        """Stop axes. It goes out at once, and overtakes everything else."""
        session = self._session
        for wanted in list(self._waiting):
            if wanted.axes & axes:
                self._waiting.remove(wanted)
                wanted.handle.fail(MoveCancelled(f"{wanted.handle.what}: it was stopped before it was sent."))
        request = new_id()
        said = Stop(id=request, client=session.client, axes=None if everything else sorted(axes))
        topic = session.topics.emergency_stop if emergency else session.topics.stop
        what = f"{'emergency ' if emergency else ''}stop of {', '.join(sorted(axes))}"
        handle: Handle[Any] = Handle(what, self._unseen.append)
        for axis in axes:
            self._stops[axis] = handle
        return session.say(topic, request, lambda: said, what, once=True, handle=handle, timeless=True)

    def failures(self) -> list[Exception]:
        """What failed and was seen by nobody."""
        return [
            handle.error
            for handle in self._unseen
            if not handle.seen and handle.error is not None and not isinstance(handle.error, MoveCancelled)
        ]

    async def drain(self) -> None:
        """Wait until all verbs have ended."""
        while self._under_way:
            handle = next(iter(self._under_way))
            seen = handle.seen
            try:
                await handle.wait()
            except BusError:
                handle.seen = seen
            self._under_way.discard(handle)

    def close(self) -> None:
        """Say nothing more."""
        if self._work is not None:
            self._work.cancel()
        for wanted in self._waiting:
            wanted.handle.fail(MoveCancelled(f"{wanted.handle.what}: the connection was closed before it was sent."))
        self._waiting.clear()

    def _cancel(self, handle: RemoteMove[Any]) -> None:
        for wanted in self._waiting:
            if wanted.handle is handle:
                self._waiting.remove(wanted)
                handle.fail(MoveCancelled(f"{handle.what} was cancelled."))
                return
        if handle.request is not None:
            self._session.ask(PLANT, "cancel", {"request": handle.request}, f"cancelling {handle.what}")
        else:
            handle.fail(MoveCancelled(f"{handle.what} was cancelled."))

    async def _send(self) -> None:
        try:
            while self._waiting:
                wanted = self._waiting[0]
                try:
                    await self._stopped(wanted.axes)
                    lease = await self._control.cover(wanted.covered)
                except (BusError, ValueError) as error:
                    if self._waiting and self._waiting[0] is wanted:
                        self._waiting.popleft()
                    wanted.handle.fail(error)
                    continue
                if not self._waiting or self._waiting[0] is not wanted:
                    continue  # it was stopped or cancelled meanwhile
                self._waiting.popleft()
                self._say(wanted, lease)
        finally:
            self._work = None

    def _say(self, wanted: _Wanted, lease: int) -> None:
        session = self._session
        life = self._life if wanted.at is None else max(self._life, wanted.at - session.now() + self._life)
        wanted.handle.request = new_id()
        session.ask(
            wanted.name,
            wanted.verb,
            wanted.arguments,
            wanted.handle.what,
            once=True,
            lease=lease,
            life=life,
            at=wanted.at,
            handle=wanted.handle,
            request=wanted.handle.request,
        )

    async def _stopped(self, axes: frozenset[str]) -> None:
        """Wait for the stops that were said before: what follows one is not to be taken for older than it."""
        for handle in {self._stops[axis] for axis in axes if axis in self._stops}:
            seen = handle.seen
            try:
                await handle.wait()
            except BusError:
                handle.seen = seen
