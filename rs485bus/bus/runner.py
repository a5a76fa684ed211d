"""What drives an owner on an event loop: its frames go to the transport, and the alarm wakes it when it wants to be."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from rs485bus.bus.owner import Owner
from rs485bus.transport.clock import Suspensions, clock_of
from rs485bus.transport.interface import Transport

_log = logging.getLogger("rs485bus")

BLOCKED = 0.25
"""Seconds by which the event loop may be late before it is said that something blocks it."""
_STOPS_TAKE = 0.5
"""Seconds for which it is waited until stops are on the wire. A device may be left alone for a while."""
_SAID_EVERY = 10.0
"""Seconds within which that is said once."""


class OwnerRunner:
    """Between an owner and its transport.

    Args:
        owner: the machine.
        transport: its way to the wires.
        loop: the event loop, whose clock is the owner's.
    """

    def __init__(self, owner: Owner, transport: Transport, loop: asyncio.AbstractEventLoop) -> None:
        self._owner = owner
        self._transport = transport
        self._loop = loop
        self._time = clock_of(loop)
        self.drop: Callable[[str], None] = lambda reason: transport.abort()
        """Gives the connection up, for a reason."""
        self._ask: Callable[[bytes, object], None] | None = getattr(transport, "ask", None)
        self.blocked: Callable[[float], None] = lambda seconds: None
        """Told for how many seconds the event loop did not run while it had to."""
        self._suspensions = Suspensions(loop)
        self._said_blocked_at = float("-inf")
        self._alarm = transport.alarm(self._wake)
        self._running = False
        self._again = False
        self._woken = False
        self._is_drained = False
        self._wakes_at = float("inf")

    def received(self, data: bytes) -> None:
        """Bytes came in."""
        # Who is told of a reply may ask for more: that goes out when all bytes are understood.
        running, self._running = self._running, True
        try:
            self._owner.feed(data, self._time())
        finally:
            self._running = running
        self.look()

    def answered(self, frame: bytes, asked: object) -> None:
        """A frame came in, with a number that tells which job it answers; None where that is not known."""
        job = self._owner.pair.job
        if job is not None and job is asked:
            self._owner.pair.is_out(self._time())
            self.received(frame)
        else:
            self._owner.feed_late(frame, asked, self._time())
            self.look()

    def look(self) -> None:
        """The owner may have to be woken sooner than it was to be."""
        if self._running:
            self.run()
            return
        wake, now = self._owner.wake, self._time()
        if wake <= now:
            self.run()
        else:
            self._set_alarm(wake, now)

    def run(self) -> None:
        """Let the owner do what is due, send what it wants to send, and set the alarm."""
        if self._running:
            self._again = True  # asked for from within: the loop below comes round again
            return
        self._running = True
        owner, transport, clock, suspensions = self._owner, self._transport, self._time, self._suspensions
        try:
            while True:
                self._again = False
                ahead = suspensions.clock()
                now = clock()
                ahead -= now
                if ahead > suspensions.limit and self._was_suspended(suspensions.take(ahead)):
                    return
                if now - self._wakes_at > BLOCKED:
                    self._say_blocked(now)
                if now >= (owner.one_way.ends_at if owner.pair.job is None else owner.pair.owed_until) and (
                    transport.unsent
                ):
                    # It must not arrive later. That the port is lost is told next.
                    self.drop("what was sent could not leave in its time, and would have arrived later")
                    return
                quiet_at = owner.pair.quiet_at
                frame = owner.tick(now, self._alarm.lead)
                if frame is not None:
                    if self._woken and self._wakes_at < quiet_at:
                        self._alarm.learn(clock() - quiet_at)
                        self._woken = False
                    while clock() < owner.send_at:
                        pass  # less than the alarm's lead
                    if self._ask is None:
                        transport.write(frame)
                    else:
                        self._ask(frame, owner.sent)
                if not self._again:
                    break  # after a frame there is a silence: there is nothing more to send
            self._set_alarm(owner.wake, now)
        except BaseException:
            # A second Ctrl-C, say, in the middle of this: what stops motors must go on.
            self._loop.call_soon(self.run)
            raise
        finally:
            self._running = False

    def after_stops(self, callback: Callable[[], None]) -> None:
        """Call back as soon as all stops that wait are on the wire; before long, too, where they cannot go out."""
        called: list[None] = []

        def once() -> None:
            if not called:
                called.append(None)
                callback()

        if self._owner.gate.closed:
            callback()
            return
        self._owner.after_stops(once)
        self._loop.call_later(_STOPS_TAKE, once)
        self.run()

    def close(self) -> None:
        """Wake the owner never again."""
        self._alarm.close()

    def _wake(self) -> None:
        """The alarm went off."""
        if self._owner.pair.job is not None and not self._is_drained:
            # The reply may be there and not be read yet, on a loop that was held up, say: that comes first.
            self._is_drained = True
            self._loop.call_soon(self._wake)
            return
        self._is_drained = False
        self._woken = True
        try:
            self.run()
        finally:
            self._woken = False

    def _was_suspended(self, seconds: float) -> bool:
        """Nobody fed the drives, and the adapter may have been without power. Returns whether the port is given up."""
        if self._owner.gate.connected:
            self.drop(f"the computer was suspended for {seconds:.1f} s")
        return self._owner.gate.connected

    def _say_blocked(self, now: float) -> None:
        late, self._wakes_at = now - self._wakes_at, float("inf")
        if now - self._said_blocked_at > _SAID_EVERY:
            self._said_blocked_at = now
            _log.warning(
                "the event loop did not run for %.2f s: nothing was fed, supervised or stopped meanwhile. Something in "
                "this program blocks it (call that in a thread: await asyncio.to_thread(...)), or the computer is busy",
                late,
            )
        self.blocked(late)

    def _set_alarm(self, wake: float, now: float) -> None:
        self._wakes_at = wake if wake > now else now  # it cannot be late for what has passed
        self._alarm.set(wake, likely=self._owner.pair.job is None)
