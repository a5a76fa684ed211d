"""A command as a process: what its signals and its exit codes mean, and what becomes of it when nobody reads on."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
from collections.abc import Callable, Coroutine, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

import typer
from rich.console import Console
from rich.markup import escape

from rs485bus.cli import what_to_install
from rs485bus.cli.settings import settings
from rs485bus.errors import (
    BusError,
    LimitExceeded,
    OutcomeUnknown,
    PlantFileError,
    PortError,
    StopUnconfirmed,
)


class WrongUse(ValueError):
    """The command was called in a way that cannot be meant. The message says how to call it."""


DONE, FAILED, WRONG_INPUT, UNKNOWN, NO_PORT, INTERRUPTED = 0, 1, 2, 3, 4, 130
_PIPE_WIDTH = 500
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


class Output(Console):
    """The standard output. Where nobody reads it any more, `BrokenPipeError` is raised once, and nothing afterwards."""

    def on_broken_pipe(self) -> None:
        """rich would raise `SystemExit`, which ends an event loop before the motors stand."""
        self.quiet = True
        nobody_reads()
        raise BrokenPipeError("nobody reads the output any more")


def nobody_reads() -> None:
    """Write to nowhere from now on."""
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


def console() -> Output:
    """Where results go. Only on a terminal are long lines broken."""
    return Output(highlight=False, width=None if sys.stdout.isatty() else _PIPE_WIDTH)


@contextmanager
def _asking() -> Iterator[None]:
    """Have Ctrl-C end a question, as it does outside of `run`."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, former)


def agrees(question: str) -> bool:
    """Ask for a yes. Nothing may move meanwhile: the event loop waits."""
    with _asking():
        return typer.confirm(question)


def ask_number(question: str, usual: int) -> int:
    """Ask for a number. Nothing may move meanwhile: the event loop waits."""
    with _asking():
        return int(typer.prompt(question, default=usual, type=int))


def start(make: Callable[[], Coroutine[Any, Any, int]], *, virtual: bool = False) -> NoReturn:
    """Run a coroutine, and end the command with the exit code that it returns."""
    raise typer.Exit(run(make, virtual=virtual))


def run(make: Callable[[], Coroutine[Any, Any, int]], *, virtual: bool = False) -> int:
    """Run a coroutine, perhaps in virtual time; say what went wrong in words.

    To be terminated, to lose the terminal and to be interrupted once or often are the same: the coroutine is cancelled,
    and the motors are stopped before the command ends. A signal that the command was started to ignore stays ignored;
    a shell has its background jobs ignore Ctrl-C.

    Returns:
        The exit code.
    """
    task: asyncio.Task[Any] | None = None
    signalled = False
    noted: list[str] = []

    def cancel() -> None:
        nonlocal signalled
        signalled = True
        if task is not None and not task.done():
            loop.call_soon_threadsafe(task.cancel)

    async def main() -> int:
        nonlocal task
        task = asyncio.current_task()
        try:
            return INTERRUPTED if signalled else await make()
        except asyncio.CancelledError as cancelled:
            noted.extend(getattr(cancelled, "__notes__", ()))
            raise

    factory: Callable[[], asyncio.AbstractEventLoop] | None = None
    if virtual:
        from rs485bus.sim import VirtualClockLoop

        factory = VirtualClockLoop
    try:
        with _signals(cancel), asyncio.Runner(loop_factory=factory) as runner:
            loop = runner.get_loop()
            return runner.run(main())
    except asyncio.CancelledError:
        if not signalled:
            raise
        for note in dict.fromkeys(noted):
            print(note, file=sys.stderr)
        return UNKNOWN if _tells_of_no_stand(noted) else INTERRUPTED
    except typer.Abort:
        print("Interrupted.", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        if settings.debug:
            raise
        return tell(error)


@contextmanager
def _signals(cancel: Callable[[], None]) -> Iterator[None]:
    """Have what ends a process call `cancel` instead."""

    def handle(number: int, frame: FrameType | None) -> None:
        cancel()

    handled = [getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)]
    former = {number: signal.getsignal(number) for number in handled}
    for number, handler in former.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, handle)
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler or signal.SIG_DFL)


def tell(error: Exception) -> int:
    """Say what went wrong, in words and without a traceback. Returns the exit code."""
    causes = list(_causes(error))
    told = [cause for cause in causes if not isinstance(cause, BrokenPipeError)]
    if len(told) < len(causes):
        nobody_reads()
    errors = Console(stderr=True, highlight=False, width=None if sys.stderr.isatty() else _PIPE_WIDTH)
    for text in dict.fromkeys(_words(cause) for cause in told):
        errors.print(text)
    for note in dict.fromkeys(note for cause in told for note in getattr(cause, "__notes__", ())):
        errors.print(escape(note))
    return exit_code(error)


def _words(error: Exception) -> str:
    name = "Error" if isinstance(error, WrongUse) else type(error).__name__
    if isinstance(error, ModuleNotFoundError) and (needed := what_to_install(error)):
        return escape(needed)
    if isinstance(error, BusError | ValueError | OSError):
        return f"[red]{name}:[/red] {escape(str(error))}"
    return (
        f"[red]{name}:[/red] {escape(str(error))}\nThis is a mistake in rs485bus. The same command with --debug shows "
        "where; please report that."
    )


def exit_code(error: Exception) -> int:
    """What the command ends with, by the worst of an error's causes."""
    codes = {_exit_code(cause) for cause in _causes(error)}
    if any(_tells_of_no_stand(getattr(cause, "__notes__", ())) for cause in _causes(error)):
        return UNKNOWN
    return UNKNOWN if UNKNOWN in codes else max(codes)


def _tells_of_no_stand(notes: Iterable[str]) -> bool:
    """Whether an error's notes hold what `StopUnconfirmed` says: it came while another error was raised."""
    return any("could not be seen standing" in note for note in notes)


def _exit_code(error: Exception) -> int:
    match error:
        case PlantFileError() | LimitExceeded() | WrongUse():
            return WRONG_INPUT
        case OutcomeUnknown() | StopUnconfirmed():
            return UNKNOWN
        case PortError():
            return NO_PORT
        case _:
            return FAILED


def _causes(error: Exception) -> Iterator[Exception]:
    """The errors in a group of groups."""
    if isinstance(error, ExceptionGroup):
        for inner in error.exceptions:
            yield from _causes(inner)
    else:
        yield error
