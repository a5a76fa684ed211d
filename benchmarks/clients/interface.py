"""What every library is asked to do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class AsyncClient(Protocol):
    """A library whose calls are coroutines."""

    async def open(self, port: str, baudrate: int, timeout: float) -> None:
        """Open the port. `timeout` is how long a reply may take, in seconds."""

    async def read(self, unit: int, register: int, count: int) -> Sequence[int]:
        """Read holding registers. Raises whatever the library raises."""

    async def write(self, unit: int, register: int, values: Sequence[int]) -> None:
        """Write registers with function 16."""

    async def stop(self, unit: int, register: int, values: Sequence[int]) -> None:
        """The same, as urgently as the library can."""

    async def close(self) -> None: ...


class BlockingClient(Protocol):
    """A library whose calls block."""

    def open(self, port: str, baudrate: int, timeout: float) -> None:
        """Open the port. `timeout` is how long a reply may take, in seconds."""

    def read(self, unit: int, register: int, count: int) -> Sequence[int]:
        """Read holding registers. Raises whatever the library raises."""

    def write(self, unit: int, register: int, values: Sequence[int]) -> None:
        """Write registers with function 16."""

    def close(self) -> None: ...
