"""Packages that only some parts need: an extra brings each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rs485bus.errors import NotSupported


@contextmanager
def brought_by(extra: str, package: str, who: str) -> Iterator[None]:
    """Import a package in this block; where it is not installed it is said what to install.

    Args:
        extra: the extra that brings it.
        package: its name.
        who: what needs it: "Pictures need".

    Raises:
        NotSupported: it is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as missing:
        if (missing.name or "").split(".")[0] != package:
            raise
        raise NotSupported(
            f"{who} the package {package}, which is not installed. Install it with:\n"
            f'    pip install "rs485bus[{extra}]"'
        ) from missing
