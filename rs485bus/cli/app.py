"""The command `rs485bus`: its options, and where its sub-commands come from (`commands`)."""

from __future__ import annotations

import atexit
import signal
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from rs485bus import __version__
from rs485bus.cli.commands import COMMANDS
from rs485bus.cli.lazy import LazyGroup, load
from rs485bus.cli.settings import Debug, Verbose, set_up_logging, settings

_HELP = ["-h", "--help"]
EXIT_CODES = (
    "Exit codes: 0 done; 1 not done, and why is said; 2 wrong arguments, or a plant file with mistakes; 3 nobody knows "
    "whether it was done, or a motor was not seen standing: look at the machine; 4 the port cannot be opened; "
    "130 interrupted, and all motors were stopped."
)

app = typer.Typer(
    name="rs485bus",
    help="Motor drives that share one RS-485 pair.",
    epilog=EXIT_CODES,
    cls=LazyGroup,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": _HELP},
)


@app.callback(invoke_without_command=True)
def _options(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
    verbose: Verbose = 0,
    debug: Debug = False,
) -> None:
    set_up_logging()
    if version:
        print(__version__)
        raise typer.Exit


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command that the arguments name, those of the process usually. What goes wrong outside of a bus is told
    here."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        if len(given) == 2 and given[0] in COMMANDS and given[1] in _HELP:
            # Without the options before the command's name, which take their time to be read.
            load(given[0], COMMANDS[given[0]]).main(["--help"], prog_name=f"rs485bus {given[0]}")
        app(given)
    except Exception as error:
        if settings.debug or isinstance(error, ModuleNotFoundError):
            raise
        from rs485bus.cli.process import tell

        sys.exit(tell(error))
    finally:
        # The exit code is decided. Ctrl-C while Python ends would replace it by that of a process that was killed.
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
