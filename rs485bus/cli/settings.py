"""What holds for a whole run of the command: how much it says, and whether it shows tracebacks."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Annotated, Any

import typer

_FRAMES = 2


@dataclass
class Settings:
    """As the options of one run say."""

    verbose: int = 0
    """1: what the bus notices; 2: each frame."""
    debug: bool = False
    """Show tracebacks."""

    @property
    def frames(self) -> bool:
        """Whether each frame is shown."""
        return self.verbose >= _FRAMES


settings = Settings()


def set_up_logging() -> None:
    """Have the log say as much as was asked for."""
    level = (logging.ERROR, logging.INFO, logging.DEBUG)[min(settings.verbose, _FRAMES)]
    logging.basicConfig(level=level, format="%(levelname)s %(message)s", force=True)
    for talkative in ("asyncio", "pymodbus", "matplotlib", "PIL", "markdown_it"):
        logging.getLogger(talkative).setLevel(logging.WARNING)


def _louder(count: int) -> int:
    if count:
        settings.verbose += count
        set_up_logging()
    return count


def _debug(on: bool) -> bool:
    settings.debug = settings.debug or on
    return on


Verbose = Annotated[
    int,
    typer.Option(
        "--verbose", "-v", count=True, callback=_louder, help="Say what the bus notices; -vv shows each frame."
    ),
]
Debug = Annotated[bool, typer.Option("--debug", callback=_debug, help="Show tracebacks of errors.")]


def usual_options() -> list[Any]:
    """The options that each command has, to be given behind its name as well as before it."""

    def options(verbose: Verbose = 0, debug: Debug = False) -> None: ...

    alone = typer.Typer(add_completion=False)
    alone.command()(options)
    parameters = typer.main.get_command(alone).params
    for parameter in parameters:
        parameter.expose_value = False
    return [parameter for parameter in parameters if parameter.name in ("verbose", "debug")]
