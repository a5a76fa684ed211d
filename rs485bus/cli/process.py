"""A command as a process: what its signals and its exit codes mean, and what becomes of it when nobody reads on."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import signal
import socket
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
    OutcomeUnknown,
    PortError,
    StopUnconfirmed,
)


class WrongUse(ValueError):
    """The command was called in a way that cannot be meant. The message says how to call it."""


DONE, FAILED, WRONG_INPUT, UNKNOWN, NO_PORT, INTERRUPTED = 0, 1, 2, 3, 4, 130
_PIPE_WIDTH = 500
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGBREAK")
_SUSPENDS = "SIGTSTP"
_CANNOT_WRITE = (errno.ENOSPC, errno.EIO, errno.EBADF)


class Output(Console):
    """The standard output. Where nobody reads it any more, `BrokenPipeError` is raised once, and nothing afterwards."""

    def on_broken_pipe(self) -> None:
        """rich would raise `SystemExit`, which ends an event loop before the motors stand."""
        self.quiet = True
        nobody_reads()
        raise BrokenPipeError("nobody reads the output any more")


def nobody_reads() -> None:
    """Write to nowhere from now on."""
    with open(os.devnull, "w") as nowhere, contextlib.suppress(OSError, ValueError):  # it is a file of its own, mostly
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


def console() -> Output:
    """Where results go. Only on a terminal are long lines broken."""
    return Output(highlight=False, width=None if sys.stdout.isatty() else _PIPE_WIDTH)


@contextmanager
def _asking() -> Iterator[None]:
    """Have any signal end a question at once: while one is asked, the event loop does not run."""

    def give_up() -> None:
        raise typer.Abort

    in_main = threading.current_thread() is threading.main_thread()
    try:
        with _signals(give_up, suspends=True) if in_main else contextlib.nullcontext():
            yield
    except typer.Abort as abort:
        with contextlib.suppress(OSError):  # the terminal may have gone
            print()
        if isinstance(abort.__context__, EOFError):
            raise WrongUse("Nobody is there to answer: run it in a terminal, or with --yes.") from None
        raise


def agrees(question: str) -> bool:
    """Ask for a yes. Nothing may move meanwhile: the event loop waits.

    Raises:
        typer.Abort: a signal came instead of an answer.
        WrongUse: nobody can answer.
    """
    with _asking():
        return typer.confirm(question)


def ask_number(question: str, usual: int, check: Callable[[int], None] = lambda number: None) -> int:
    """Ask for a number, again until `check` raises nothing. Waits and raises as `agrees`."""
    while True:
        with _asking():
            number = int(typer.prompt(question, default=usual, type=int))
        try:
            check(number)
        except BusError as error:
            print(error)
        else:
            return number


def start(make: Callable[[], Coroutine[Any, Any, int]], *, virtual: bool = False, suspends: bool = False) -> NoReturn:
    """Run a coroutine as `run` does, and end the command with the exit code that it returns."""
    raise typer.Exit(run(make, virtual=virtual, suspends=suspends))


def run(make: Callable[[], Coroutine[Any, Any, int]], *, virtual: bool = False, suspends: bool = False) -> int:
    """Run a coroutine, perhaps in virtual time; say what went wrong in words.

    To be terminated, to lose the terminal and to be interrupted once or often are the same: the coroutine is cancelled,
    and the motors are stopped before the command ends. So is Ctrl-Z, unless it `suspends`, which a command may that
    moves nothing: a suspended one feeds no watchdog and sees no limit. A signal that the command was started to ignore
    stays ignored; a shell has its background jobs ignore Ctrl-C.

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
        with _signals(cancel, suspends), asyncio.Runner(loop_factory=factory) as runner:
            loop = runner.get_loop()
            with _woken_by_signals(loop):
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
def _woken_by_signals(loop: asyncio.AbstractEventLoop) -> Iterator[None]:
    """Have signals wake the loop. One that comes just before it begins to wait would be handled when that ends."""
    if os.name != "posix":  # Windows' own loop does that
        yield
        return
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.setblocking(False)
        theirs.setblocking(False)
        loop.add_reader(ours, lambda: ours.recv(4096))
        former = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(former)
            loop.remove_reader(ours)


@contextmanager
def _signals(act: Callable[[], None], suspends: bool) -> Iterator[None]:
    """Have what ends a process call `act` instead."""

    def handle(number: int, frame: FrameType | None) -> None:
        act()

    names = _SIGNALS if suspends else (*_SIGNALS, _SUSPENDS)
    handled = [getattr(signal, name) for name in names if hasattr(signal, name)]
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
    with contextlib.suppress(OSError):  # whether anybody reads it or not, the exit code tells
        for text in dict.fromkeys(_words(cause) for cause in told):
            errors.print(text)
        for note in dict.fromkeys(note for cause in told for note in getattr(cause, "__notes__", ())):
            errors.print(escape(note))
    return exit_code(error)


def _words(error: Exception) -> str:
    if isinstance(error, ModuleNotFoundError) and (needed := what_to_install(error)):
        return escape(needed)
    if isinstance(error, BusError):
        return f"[red]{type(error).__name__}:[/red] {escape(str(error))}"
    if isinstance(error, OSError) and error.filename is not None:
        return f"[red]Error:[/red] {escape(str(error.filename))}: {escape(error.strerror or str(error))}"
    if isinstance(error, OSError) and error.errno in _CANNOT_WRITE:
        return f"[red]Error:[/red] the output cannot be written: {escape(error.strerror or str(error))}"
    if isinstance(error, ValueError | OSError):
        return f"[red]Error:[/red] {escape(str(error))}"
    return (
        f"[red]{type(error).__name__}:[/red] {escape(str(error))}\nThis is a mistake in rs485bus. The same command "
        "with --debug shows where; please report that."
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
        case OutcomeUnknown() | StopUnconfirmed():
            return UNKNOWN
        case PortError():
            return NO_PORT
        case ValueError():
            return WRONG_INPUT
        case _:
            return FAILED


def _causes(error: Exception) -> Iterator[Exception]:
    """The errors in a group of groups."""
    if isinstance(error, ExceptionGroup):
        for inner in error.exceptions:
            yield from _causes(inner)
    else:
        yield error
