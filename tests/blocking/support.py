"""A blocking bus in virtual time: it passes while the test waits for something, and only then."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rs485bus.blocking.loop import shared_loop
from rs485bus.sim import VirtualClockLoop


@contextmanager
def virtual_time() -> Iterator[None]:
    """Have the buses that are opened meanwhile run on a virtual clock."""
    former, shared_loop.make = shared_loop.make, VirtualClockLoop
    try:
        yield
    finally:
        shared_loop.make = former
