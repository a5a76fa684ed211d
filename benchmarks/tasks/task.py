"""What a client's process is told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from benchmarks.clients.interface import AsyncClient, BlockingClient
from benchmarks.clients.registry import LIBRARIES
from benchmarks.setting import Setting

Result = dict[str, Any]
"""What it found, as it goes through JSON."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One task.

    Args:
        library: which library.
        name: which task.
        port: the line's; empty for tasks that have their own.
        setting: how the line is set.
        seconds: how long to measure.
        amount: how much of what the task counts.
        case: which of `benchmarks.lossy_cases` the line is, for the rows that have cases.
        seed: makes chance reproducible.
    """

    library: str
    name: str
    port: str = ""
    setting: Setting = field(default_factory=Setting)
    seconds: float = 1.0
    amount: int = 0
    case: str = ""
    seed: int = 1

    @property
    def blocking(self) -> bool:
        return LIBRARIES[self.library].blocking

    def client(self) -> AsyncClient | BlockingClient:
        return LIBRARIES[self.library].client()
