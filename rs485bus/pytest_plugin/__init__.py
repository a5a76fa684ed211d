"""Fixtures for tests of your own machine: a virtual line with virtual drives, in virtual time, with faults on call.

pytest finds them where rs485bus is installed. Nothing of the bus is loaded before a test asks for one of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rs485bus.pytest_plugin.clock import VirtualClock
    from rs485bus.pytest_plugin.drives import VirtualDrives
    from rs485bus.pytest_plugin.faults import LineFaults
    from rs485bus.sim import VirtualLine


@pytest.fixture
def virtual_clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[VirtualClock]:
    """Virtual time: `virtual_clock.run(main())` for coroutines. Blocking buses that are opened meanwhile run in it.

    `time.sleep` takes no time then: so many seconds pass on the line.
    """
    from rs485bus.pytest_plugin.clock import VirtualClock

    with VirtualClock(monkeypatch) as clock:
        yield clock


@pytest.fixture
def virtual_line() -> VirtualLine:
    """An RS-485 line at 115200 bit/s, to be given to `open_bus`. `virtual_drives` puts drives on it."""
    from rs485bus.sim import VirtualLine

    return VirtualLine(baudrate=115200)


@pytest.fixture
def virtual_drives(virtual_line: VirtualLine, virtual_clock: VirtualClock) -> VirtualDrives:
    """Puts virtual drives on `virtual_line`: `virtual_drives.mks(1)`, `.zlac(3)`, `.tlr(4)`, `.unit(7, {0: 5})`."""
    from rs485bus.pytest_plugin.drives import VirtualDrives

    return VirtualDrives(virtual_line, virtual_clock)


@pytest.fixture
def line_faults(virtual_line: VirtualLine) -> LineFaults:
    """Faults of `virtual_line`, when the test asks for them: `line_faults.lose_replies(1, count=3)`."""
    from rs485bus.pytest_plugin.faults import LineFaults

    return LineFaults(virtual_line)
