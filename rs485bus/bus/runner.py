"""What drives an owner on an event loop: its frames go to the transport, and the alarm wakes it when it wants to be."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rs485bus.bus.owner import Owner
from rs485bus.transport.interface import Transport


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
        self.drop: Callable[[str], None] = lambda reason: transport.abort()
        """Gives the connection up, for a reason."""
        self._alarm = transport.alarm(self._wake)
        self._running = False
        self._again = False
        self._woken = False
        self._wakes_at = float("inf")

    def received(self, data: bytes) -> None:
        """Bytes came in."""
        # Who is told of a reply may ask for more: that goes out when all bytes are understood.
        running, self._running = self._running, True
        try:
            self._owner.feed(data, self._loop.time())
        finally:
            self._running = running
        self.look()

    def look(self) -> None:
        """The owner may have to be woken sooner than it was to be."""
        wake = self._owner.wake
        if self._running or wake <= self._loop.time():
            self.run()
        else:
            self._set_alarm(wake)

    def run(self) -> None:
        """Let the owner do what is due, send what it wants to send, and set the alarm."""
        if self._running:
            self._again = True  # asked for from within: the loop below comes round again
            return
        self._running = True
        owner, transport, loop = self._owner, self._transport, self._loop
        try:
            while True:
                self._again = False
                now = loop.time()
                if now >= (owner.one_way_ends_at if owner.pair.job is None else owner.pair.deadline) and (
                    transport.unsent
                ):
                    # It must not arrive later. That the port is lost is told next.
                    self.drop("what was sent could not leave in its time, and would have arrived later")
                    return
                quiet_at = owner.pair.quiet_at
                frame = owner.tick(now, self._alarm.lead)
                if frame is not None:
                    if self._woken and self._wakes_at < quiet_at:
                        self._alarm.learn(loop.time() - quiet_at)
                        self._woken = False
                    while loop.time() < owner.send_at:
                        pass  # less than the alarm's lead
                    transport.write(frame)
                if not self._again:
                    break  # after a frame there is a silence: there is nothing more to send
            self._set_alarm(owner.wake)
        except BaseException:
            # A second Ctrl-C, say, in the middle of this: what stops motors must go on.
            loop.call_soon(self.run)
            raise
        finally:
            self._running = False

    def close(self) -> None:
        """Wake the owner never again."""
        self._alarm.close()

    def _wake(self) -> None:
        """The alarm went off."""
        self._woken = True
        try:
            self.run()
        finally:
            self._woken = False

    def _set_alarm(self, wake: float) -> None:
        self._wakes_at = wake
        self._alarm.set(wake, likely=self._owner.pair.job is None)
