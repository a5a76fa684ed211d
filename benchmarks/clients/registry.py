"""Which libraries there are, and which of them are installed."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import cast

import rs485bus
from benchmarks.clients.interface import AsyncClient, BlockingClient


@dataclass(frozen=True, slots=True)
class Library:
    """One library that is measured.

    `package` is the distribution it comes in (empty where it is part of this), `python` the least Python it wants.
    """

    name: str
    package: str
    module: str
    blocking: bool = False
    keeps_silence: bool = True
    python: tuple[int, int] = (3, 11)

    @property
    def version(self) -> str:
        """Its version; empty if it is not installed."""
        if not self.package:
            return rs485bus.__version__
        try:
            return version(self.package)
        except PackageNotFoundError:
            return ""

    @property
    def missing(self) -> str:
        """Why it cannot be measured here; empty if it can."""
        if sys.version_info < self.python:
            return f"{self.name} needs Python {self.python[0]}.{self.python[1]}"
        if not self.version:
            return f'{self.name} is not installed: pip install "rs485bus[bench]"'
        return ""

    def client(self) -> AsyncClient | BlockingClient:
        """A client of it."""
        module = importlib.import_module(f"benchmarks.clients.{self.module}")
        return cast(AsyncClient | BlockingClient, module.Client())


OURS = "rs485bus"
BRIEF = "rs485bus-brief"
SERIALX = "rs485bus-serialx"
FLOOR = "floor"

LIBRARIES = {
    library.name: library
    for library in (
        Library(FLOOR, "", "floor", blocking=True),
        Library(OURS, "", "ours"),
        Library(BRIEF, "", "ours_brief", keeps_silence=False),
        Library(SERIALX, "serialx", "ours_by_serialx"),
        Library("pymodbus", "pymodbus", "with_pymodbus", keeps_silence=False),
        Library("minimalmodbus", "minimalmodbus", "with_minimalmodbus", blocking=True),
        Library("anymodbus", "anymodbus", "with_anymodbus", python=(3, 13)),
        Library("tmodbus", "tmodbus", "with_tmodbus", python=(3, 12)),
    )
}
