"""The port of a bus: it is opened, and opened again whenever it was lost."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from rs485bus.arguments import function
from rs485bus.bus.config import BusConfig
from rs485bus.bus.handle import start_task
from rs485bus.bus.line.host_slack import HostSlack
from rs485bus.bus.other_programs import OtherPrograms
from rs485bus.bus.owner import Owner
from rs485bus.bus.runner import OwnerRunner
from rs485bus.errors import PortBusy, PortError
from rs485bus.transport.interface import Transport

HOST_SLACK = 0.008
"""Seconds by which a computer that does other things may be late to hand over what a real port received."""
_log = logging.getLogger("rs485bus")

SAID_EVERY = 60.0
"""Seconds within which the log is told once of a port that does not stay open."""
HANGS_UP_WITHIN = 2.0
"""Seconds within which a new connection ends where the other end does not want it."""
_GIVING_UP_TAKES = 1.0
"""Seconds that closing waits for an attempt to open the port."""


class Port:
    """Keeps a transport open until `close`. It is the sink of what the transport receives.

    The pauses between two attempts grow from `reopen_min` to `reopen_max`. They begin anew only after a connection that
    was of use: it has carried an answer, or it stood for longer than the longest pause. A gateway that accepts each
    connection and hangs up at once is therefore asked as seldom as one that is not there.

    It waits by timers, not in a task: the port is opened again, and motors are stopped, also while `asyncio.run`
    cancels every task at the end of a program.
    """

    def __init__(self, transport: Transport, owner: Owner, runner: OwnerRunner, config: BusConfig) -> None:
        self.received = runner.received
        """Bytes came in."""
        self.answered = runner.answered
        """A frame came in, with a number that tells what it answers."""
        runner.drop = self.drop
        self.programs = OtherPrograms(transport)
        owner.journal.missed = self.programs.missed
        owner.pair.strangers.found = self._say_stranger
        self._said_stranger_at = float("-inf")
        self._trouble = ""
        self._listeners: list[Callable[[], None]] = []
        self._transport = transport
        self._owner = owner
        self._runner = runner
        self._config = config
        self._loop = asyncio.get_running_loop()
        self._is_open = False
        self._opening = False
        self._lost_while_opening: Exception | None = None
        self._closed = False
        self._dropped = ""
        """Why this side gave the connection up."""
        self._opened_at = 0.0
        self._answers = 0
        """How many answers the bus had had when the port was opened."""
        self._pause = config.reopen_min
        self._timer: asyncio.TimerHandle | None = None
        self._attempt: asyncio.Task[None] | None = None
        self._was_of_use = True
        self._says_lost = False
        """The log's latest word is that the port is lost."""
        self._said_at = float("-inf")
        self._unsaid = 0
        """How often it was lost since the log was told."""
        self._failed = ""
        """What the latest attempt raised that no transport should raise."""

    @property
    def trouble(self) -> str:
        """Why the port is away, or comes for moments only, and what to do about it; empty if it is there."""
        there = self._is_open and (self._was_of_use or self._count_answers() != self._answers)
        return "" if there else self._trouble

    @property
    def advice(self) -> str:
        """What explains that answers do not come, and what to do about it; empty if nothing is known."""
        silent = "" if self._count_answers() else getattr(self._transport, "silent_hint", "")
        strange = self._stranger() if self._owner.pair.strangers.were_many(self._loop.time()) else ""
        return str(self.programs) or getattr(self._transport, "diagnosis", "") or strange or silent

    def listen(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Have `callback` called on the event loop whenever the port is lost. Returns a function that ends that."""
        self._listeners.append(function("callback", callback))

        def end() -> None:
            if callback in self._listeners:
                self._listeners.remove(callback)

        return end

    async def open(self) -> None:
        """Open it for the first time. Raises `PortError`; `PortBusy` where another bus of this program holds it."""
        holder = _HELD.get(id(self._transport))
        if holder is not None and holder._loop.is_running():
            raise PortBusy(
                f"{self._transport.name} is open already, by another bus of this program. A pair has one master: use "
                "that bus for all that is on it, or close it first."
            )
        _HELD[id(self._transport)] = self
        try:
            lost = await self._open()
        except BaseException:
            self._let_go()
            raise
        if lost is not None:
            self.lost(lost)
        if self._config.silence is not None:
            _log.warning(
                "%s: %.2f ms of silence between frames, as configured, instead of the %.2f ms of Modbus (t3.5)",
                self._transport.name,
                1000 * self._config.silence,
                1000 * self._transport.line.t35,
            )

    async def close(self) -> None:
        """Close it, and do not open it again."""
        self._closed = True
        self._stop_timer()
        self.programs.close()
        if self._attempt is not None:
            self._attempt.cancel()
            await asyncio.wait({self._attempt}, timeout=_GIVING_UP_TAKES)
        try:
            await self._transport.close()
        finally:
            self._let_go()

    def _let_go(self) -> None:
        if _HELD.get(id(self._transport)) is self:
            del _HELD[id(self._transport)]

    def lost(self, error: Exception | None) -> None:
        """The port is gone."""
        if self._opening:
            self._lost_while_opening = error or ConnectionResetError("the other end closed the connection")
            return
        if self._closed or not self._is_open:
            return
        self._is_open = False
        self._stop_timer()
        now = self._loop.time()
        stood = now - self._opened_at >= self._config.reopen_max
        self._was_of_use = stood or self._count_answers() != self._answers
        if self._was_of_use:
            self._pause = self._config.reopen_min
        self._say_lost(error, now, aloud=stood or now - self._said_at >= SAID_EVERY)
        self._owner.unplugged(now)
        self._runner.run()
        self._try_later()
        for listener in self._listeners:
            self._loop.call_soon(listener)

    def drop(self, reason: str) -> None:
        """Give the connection up, and what is unsent with it; it is opened again."""
        self._dropped = reason
        self._transport.abort()

    async def _open(self) -> Exception | None:
        """Open it. Returns why it was lost again meanwhile, if it was."""
        self._opening, self._lost_while_opening = True, None
        try:
            await self._transport.open(self)
        finally:
            self._opening = False
        self._is_open, self._dropped = True, ""
        self.programs.look()
        self._opened_at = self._loop.time()
        self._answers = self._count_answers()
        self._owner.pair.latency = getattr(self._transport, "receive_latency", 0.0)
        self._owner.pair.host = HostSlack(HOST_SLACK if hasattr(self._transport, "receive_latency") else 0.0)
        return self._lost_while_opening

    def _try_later(self) -> None:
        pause, self._pause = self._pause, min(2 * self._pause, self._config.reopen_max)
        self._timer = self._loop.call_later(pause, self._try)

    def _try(self) -> None:
        self._timer = None
        self._attempt = start_task(self._reopen(), "rs485bus reopening")
        self._attempt.add_done_callback(self._tried)

    def _tried(self, attempt: asyncio.Task[None]) -> None:
        # It failed, or was cancelled, as every task is at the end of a program: motors may have to be stopped yet.
        if not self._is_open and not self._closed and self._timer is None:
            self._try_later()

    async def _reopen(self) -> None:
        try:
            lost = await self._open()
        except PortError as error:
            self._trouble = str(error)
            _log.debug("%s", error)
            return
        except Exception as error:
            # A transport of somebody else's: whatever it raises, the bus goes on trying.
            self._trouble = f"{self._transport.name} could not be opened: {error!r}"
            if self._failed != repr(error):
                self._failed = repr(error)
                _log.exception("%s could not be opened; trying again", self._transport.name)
            return
        if lost is not None:
            self.lost(lost)
            return
        if self._was_of_use and self._says_lost:
            self._say_open()
        elif self._says_lost:
            # One that did not stay open is believed only after a while.
            self._timer = self._loop.call_later(self._config.reopen_max, self._say_open)
        self._owner.plugged(self._loop.time())
        self._runner.run()

    def _count_answers(self) -> int:
        """How many answers the bus has had."""
        units = self._owner.journal.stats.units.values()
        return sum(unit.replies + unit.refusals + unit.late_replies for unit in units)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    # What the log says

    def _say_lost(self, error: Exception | None, now: float, *, aloud: bool) -> None:
        why = self._dropped or error
        name, reason = self._transport.name, f": {why}" if why else ""
        hung_up = not self._dropped and not self._was_of_use and now - self._opened_at < HANGS_UP_WITHIN
        hint = getattr(self._transport, "hang_up_hint", "") if hung_up else ""
        if hint and not self._count_answers():
            hint = f"{hint} {getattr(self._transport, 'silent_hint', '')}".strip()
        self._trouble = f"{name} was lost{reason}. {hint}".strip()
        self._unsaid += 1
        if not aloud:
            _log.debug("%s was lost again%s", name, reason)
            return
        often = f" {self._unsaid} times in the last {now - self._said_at:.0f} s" if self._unsaid > 1 else ""
        _log.warning("%s was lost%s%s; trying to open it again%s", name, often, reason, hint and f". {hint}")
        self._says_lost, self._said_at, self._unsaid = True, now, 0

    def _stranger(self) -> str:
        return (
            f"Somebody else asks on {self._transport.name}: frames come that nobody here asked for "
            f"({self._owner.pair.strangers.latest.hex(' ').upper()}). Answers to it may be taken for answers to this "
            "program: positions and states may be wrong. A pair has one master: end the other program, or the other "
            "client of the gateway."
        )

    def _say_stranger(self) -> None:
        if self._loop.time() >= self._said_stranger_at + SAID_EVERY:
            self._said_stranger_at = self._loop.time()
            _log.warning("%s", self._stranger())

    def _say_open(self) -> None:
        self._timer = None
        self._says_lost = False
        _log.warning("%s is open again", self._transport.name)


_HELD: dict[int, Port] = {}
"""The ports that are open, by their transport's identity. One whose event loop has ended holds nothing any more."""
