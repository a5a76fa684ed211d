"""A question that a manual leaves open, and the answer that a drive gives when it is tried."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from typing import Any

from rs485bus.errors import BusError

_RPM = 32.0
"""The speed of what names none: whatever else a drive is set to, it can do that, and be told it."""

Facts = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What was seen."""

    words: str
    """For people."""
    options: Facts = field(default_factory=dict)
    """Options of the facade, as they stand in a plant file."""
    measured: Facts = field(default_factory=dict)
    """What else is known now: for the report."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """One question."""

    name: str
    asks: str
    """What is not known."""
    does: str
    """What happens meanwhile: "turns the motor by a quarter turn". Empty where nothing moves."""
    ask: Callable[[Any], Awaitable[Answer]]
    """Tries it on a facade that is enabled and stands."""
    bare: bool = False
    """It is tried on a `Unit`, so that nobody feeds the drive's watchdog; it stops the motor itself."""
    assumes: Facts = field(default_factory=dict)
    """Options of the facade meanwhile: the widest that the answer can be, so that nothing seen is impossible."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What came of one question."""

    question: Question
    answer: Answer | None
    error: str = ""
    """Why there is no answer."""


OpenDrive = Callable[[Facts, bool], AbstractAsyncContextManager[Any]]
"""Opens a drive alone on its bus: its facade with some options as they stand in a plant file, or bare, as a `Unit`."""


async def ask_all(
    open_drive: OpenDrive, questions: Iterable[Question], tell: Callable[[Result], None] = lambda result: None
) -> list[Result]:
    """Ask a drive some questions, one after another. It stands after each, whatever came of it.

    Args:
        open_drive: opens it anew for each question, with what was found so far. It is free to turn.
        questions: of its family.
        tell: is told of each result.

    Raises:
        BusError: it cannot be enabled, or not be stopped.
    """
    options: Facts = {"rpm": _RPM}
    results = []
    for question in questions:
        async with open_drive(options | question.assumes, question.bare) as drive:
            result = await _ask(question, drive)
        if result.answer is not None:
            options |= result.answer.options
        results.append(result)
        tell(result)
    return results


async def _ask(question: Question, drive: Any) -> Result:
    if question.does and not question.bare:
        await drive.enable()
    try:
        return Result(question=question, answer=await question.ask(drive))
    except BusError as error:
        return Result(question=question, answer=None, error=f"{type(error).__name__}: {error}")
    finally:
        if question.does and not question.bare:
            await drive.stop()


async def slope(rpm: Callable[[], Awaitable[float]], target: float, longest: float) -> float | None:
    """How fast a motor takes up speed, in rpm/s, from its speed asked again and again; None if that was not seen.

    Args:
        rpm: asks for the speed.
        target: the speed that it goes to.
        longest: seconds that it may take.
    """
    loop = asyncio.get_running_loop()
    began = loop.time()
    samples: list[tuple[float, float]] = []
    while loop.time() - began < longest:
        before = loop.time()
        speed = abs(await rpm())
        samples.append(((before + loop.time()) / 2, speed))
        if speed >= 0.97 * abs(target):
            break
    inside = [(at, speed) for at, speed in samples if 0.08 * abs(target) < speed < 0.92 * abs(target)]
    if len(inside) < 2:
        # Too quick to be seen in between: between the last one that stood and the first that had the speed.
        slow = max((at for at, speed in samples if speed <= 0.08 * abs(target)), default=None)
        fast = min((at for at, speed in samples if speed >= 0.92 * abs(target)), default=None)
        return abs(target) / (fast - slow) if slow is not None and fast is not None and fast > slow else None
    mean_at = sum(at for at, _ in inside) / len(inside)
    mean = sum(speed for _, speed in inside) / len(inside)
    spread = sum((at - mean_at) ** 2 for at, _ in inside)
    return sum((at - mean_at) * (speed - mean) for at, speed in inside) / spread


def ramp_answer(measured: float | None, asked: float, target: float, seconds: float) -> Answer:
    """What a ramp time refers to, from the acceleration that it made.

    Args:
        measured: rpm/s that was seen.
        asked: rpm/s that it should be if the time is that of the change.
        target: the change, in rpm.
        seconds: the ramp time that the drive was told.
    """
    if measured is None:
        return Answer(words="the ramp was too quick to be seen: ramp_rpm is far above the speed, and not known")
    if abs(measured - asked) < 0.15 * asked:
        return Answer(
            words=f"a ramp time is that of any change of speed ({measured:.0f} rpm/s seen, {asked:.0f} expected)",
            measured={"acceleration": round(measured, 1), "ramp_rpm": None},
        )
    ramp_rpm = _round(measured * seconds)
    return Answer(
        words=f"a ramp time is that of a change by {ramp_rpm:g} rpm, whatever it is ({measured:.0f} rpm/s seen)",
        options={"ramp_rpm": ramp_rpm},
        measured={"acceleration": round(measured, 1), "ramp_rpm": ramp_rpm},
    )


def _round(rpm: float) -> float:
    """To what a maker would have chosen: 1000, 1500, 3000."""
    step = 500.0 if rpm > 750 else 50.0 if rpm > 75 else 5.0
    return step * max(1, round(rpm / step))
