"""Files that a command is to write. One that cannot be written is refused before anything else is done."""

from __future__ import annotations

import os
from pathlib import Path

from rs485bus.cli.process import WrongUse


def check_output(path: Path | None) -> None:
    """Refuse a file that cannot be written. None is no file. Raises `WrongUse`."""
    if path is None:
        return
    if os.path.isdir(path):
        raise WrongUse(f"{path} is a folder: name a file in it.")
    if not os.path.isdir(path.parent):
        raise WrongUse(f"There is no folder {path.parent} to write {path.name} to.")
    needed = path if os.path.exists(path) else path.parent
    if not os.access(needed, os.W_OK):
        raise WrongUse(f"You may not write {path}: name another place, or look at who owns it: ls -ld {needed}")


def check_new(path: Path) -> None:
    """Refuse a file that is there already, or cannot be written. Raises `WrongUse`."""
    if os.path.exists(path) and not os.path.isdir(path):
        raise WrongUse(f"{path} is there already: name another file.")
    check_output(path)
