"""What the application was told: everything it calls goes through here, and is written down with how it ended."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Awaitable, Callable, Generator
from typing import Any

from rs485bus import MoveState
from rs485bus.bus.handle import Handle
from rs485bus.errors import BusError
from rs485bus.sim.campaigns.faults.evidence import NEVER, Call

_LASTING = frozenset({"stream"})
"""Blocks that are calls from their begin to their end: something may turn for as long."""

Recover = Callable[["Recorded", Exception], Awaitable[None]]


class Notes:
    """The calls of one run.

    Args:
        calls: where they are written down.
        now: tells the time.
        recover: what the application does after an error, before it goes on as if nothing had been; None for an
            application that gives up at the first one.
        aside: they are none of the scenario's own.
    """

    def __init__(
        self, calls: list[Call], now: Callable[[], float], recover: Recover | None = None, *, aside: bool = False
    ) -> None:
        self.calls = calls
        self.now = now
        self.recover = recover
        self.gave_up = False
        """There was an error after which another application would have gone on."""
        self._aside = aside

    def begin(self, who: Recorded | str, verb: str, args: tuple[Any, ...], options: dict[str, Any]) -> Call:
        name, shafts = (who.name, who.shafts) if isinstance(who, Recorded) else (who, ())
        call = Call(name, verb, args, options, self.now(), shafts, aside=self._aside)
        self.calls.append(call)
        return call

    def recovery(self, error: Exception) -> Recover | None:
        """What the application does after an error, before it goes on; None where it gives up, or where that is none
        of ours."""
        is_ours = isinstance(error, BusError)
        self.gave_up = self.gave_up or (is_ours and self.recover is None)
        return self.recover if is_ours else None

    def end(self, call: Call, result: object = None, error: BaseException | None = None) -> None:
        """It has ended: once."""
        if call.ended == NEVER:
            call.ended, call.result, call.error = self.now(), result, error


class Recorded:
    """An axis, a group, a bus or a unit of the package: called as itself, and each call is written down.

    Args:
        notes: where.
        real: the object.
        name: how the oracle knows it.
        shafts: what it moves.
        members: what belongs to it: the wheels of a drive.
    """

    def __init__(self, notes: Notes, real: Any, name: str, shafts: tuple[str, ...] = (), **members: Recorded) -> None:
        self.notes = notes
        self.real = real
        self.name = name
        self.shafts = shafts
        self.members = members

    def __getattr__(self, verb: str) -> Any:
        if verb in self.members:
            return self.members[verb]
        member = getattr(self.real, verb)
        if not callable(member) or inspect.isclass(member):
            return member
        return lambda *args, **options: self._call(verb, member, args, options)

    def by(self, notes: Notes) -> Recorded:
        """The same, called by somebody else."""
        return Recorded(notes, self.real, self.name, self.shafts)

    def _call(self, verb: str, member: Any, args: tuple[Any, ...], options: dict[str, Any]) -> Any:
        call = self.notes.begin(self, verb, args, options)
        try:
            answer = member(*map(_real, args), **{name: _real(value) for name, value in options.items()})
        except Exception as error:
            self.notes.end(call, None, error)
            if self.notes.recovery(error) is not None:
                return Refused()
            raise
        if isinstance(answer, Handle):
            answer.add_done_callback(lambda handle: self.notes.end(call, _result(handle), handle.error))
            self._note_parts(call, answer)
            return RecordedHandle(self, call, answer)
        if inspect.isawaitable(answer):
            if self._note_parts(call, answer):
                return RecordedHandle(self, call, answer)
            return RecordedAnswer(self, call, answer)
        if hasattr(answer, "__aenter__"):
            return RecordedBlock(self, call, answer)
        self.notes.end(call, answer)
        return answer

    def _note_parts(self, call: Call, answer: Any) -> bool:
        """A command of several axes is a call of each of them, too. Whether it is one."""
        parts = _parts(answer)
        if not parts:
            return False
        call.shafts = ()
        waiting = set(parts)
        for at, (name, handle) in enumerate(parts.items()):
            args = (call.args[at],) if at < len(call.args) else ()
            options = {key: value for key, value in call.options.items() if key not in parts}
            part = self.notes.begin(self, call.verb, (call.options[name],) if name in call.options else args, options)
            part.shafts = self.shafts[at : at + 1]

            def told(handle: Handle[Any], part: Call = part, name: str = name) -> None:
                self.notes.end(part, _result(handle), handle.error)
                waiting.discard(name)
                if not waiting and not isinstance(answer, Handle):
                    self.notes.end(call)

            handle.add_done_callback(told)
        return True


class RecordedAnswer:
    """What is awaited: a question's answer, mostly."""

    def __init__(self, who: Recorded, call: Call, real: Awaitable[Any]) -> None:
        self._who = who
        self._call = call
        self._real = real

    def __await__(self) -> Generator[Any, None, Any]:
        return self._wait().__await__()

    async def _wait(self) -> Any:
        notes = self._who.notes
        try:
            result = await self._real
        except asyncio.CancelledError:
            self._call.given_up = True
            if not isinstance(self, RecordedHandle):
                notes.end(self._call, None, asyncio.CancelledError())
            raise
        except Exception as error:
            notes.end(self._call, None, error)
            if (recover := notes.recovery(error)) is not None:
                await recover(self._who, error)
                return None
            raise
        notes.end(self._call, result)
        return result


class RecordedHandle(RecordedAnswer):
    """What happens whether it is awaited or not: its end is written down when it is told."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)

    def cancel(self) -> None:
        """End a move. That is a call, too: one that waits leaves the queue, one under way stops the axis."""
        notes = self._who.notes
        state: MoveState = self._real.state  # type: ignore[attr-defined] # a move
        under_way = state in (MoveState.STARTING, MoveState.MOVING)
        call = notes.begin(self._who, "cancel" if under_way else "take back", (), {})
        self._real.cancel()  # type: ignore[attr-defined] # a move
        notes.end(call)

    async def __aenter__(self) -> RecordedHandle:
        await self._real.__aenter__()  # type: ignore[attr-defined] # a move
        return self

    async def __aexit__(self, *error: Any) -> Any:
        return await self._real.__aexit__(*error)  # type: ignore[attr-defined]


class Refused:
    """A command that was refused as it was called, where the application goes on."""

    state = None

    def __await__(self) -> Generator[Any, None, None]:
        return iter(())  # type: ignore[return-value] # there is nothing to wait for

    def done(self) -> bool:
        """It has ended."""
        return True

    def cancel(self) -> None:
        """There is nothing to cancel."""


class RecordedBlock:
    """An `async with`: entering it and leaving it are calls."""

    def __init__(self, who: Recorded, call: Call, real: Any) -> None:
        self._who = who
        self._call = call
        self._real = real

    async def __aenter__(self) -> Any:
        notes = self._who.notes
        try:
            entered = await self._real.__aenter__()
        except BaseException as error:
            notes.end(self._call, None, error)
            raise
        if self._call.verb not in _LASTING:
            notes.end(self._call)
        return entered

    async def __aexit__(self, *error: Any) -> Any:
        notes = self._who.notes
        call = notes.begin(self._who, f"{'leave' if error[0] is None else 'abandon'} {self._call.verb}", (), {})
        try:
            swallowed = await self._real.__aexit__(*error)
        except BaseException as raised:
            notes.end(call, None, raised)
            raise
        finally:
            notes.end(self._call)
        notes.end(call)
        return swallowed


def _parts(answer: Any) -> dict[str, Handle[Any]]:
    """The commands of which a command of several axes is made, by name."""
    if isinstance(getattr(answer, "left", None), Handle):
        return {"left": answer.left, "right": answer.right}
    return dict(getattr(answer, "moves", None) or getattr(answer, "parts", None) or {})


def _real(value: Any) -> Any:
    return value.real if isinstance(value, Recorded) else value


def _result(handle: Handle[Any]) -> Any:
    return None if handle.error is not None else getattr(handle, "_result", None)
