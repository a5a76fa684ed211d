"""The command `rs485bus`."""

from __future__ import annotations

import io
import os
import sys

_EXTRAS = {
    "typer": "cli",
    "click": "cli",
    "rich": "cli",
    "pydantic": "plant",
    "pydantic_core": "plant",
    "tomlkit": "plant",
    "textual": "monitor",
    "matplotlib": "plot",
    "aiomqtt": "service",
    "serialx": "serialx",
}
"""Which extra brings a package."""


def main() -> None:
    """Run the command, or say what it needs."""
    _make_streams_usable()
    try:
        from rs485bus.cli.app import main as run

        run()
    except ModuleNotFoundError as missing:
        needed = what_to_install(missing)
        if needed is None:
            raise
        print(needed, file=sys.stderr)
        sys.exit(1)


def what_to_install(missing: ModuleNotFoundError) -> str | None:
    """What to do about a package that is not there; None for one that no extra brings."""
    package = (missing.name or "").split(".")[0]
    if package not in _EXTRAS:
        return None
    return (
        f"The command rs485bus needs the package {package} for this, which is not installed. Install it with:\n"
        f'    pip install "rs485bus[{_EXTRAS[package]}]"'
    )


def _make_streams_usable() -> None:
    """See to it that what is said ends no command: where a process was started without its standard streams, and where
    an encoding has no ° and no arrows (the locale C, pipes on Windows)."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - it is open as long as the process
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
