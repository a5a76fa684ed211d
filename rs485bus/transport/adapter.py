"""Which USB adapter a serial port belongs to, so that the same one is opened again and no other.

On another adapter there may be another pair, with other drives at the same addresses.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from rs485bus.errors import PortNotFound


@dataclass(frozen=True, slots=True)
class Adapter:
    """What the system tells of an adapter. One without a serial number is known by the socket that it is plugged in."""

    vendor: int | None
    product: int | None
    serial_number: str | None
    location: str | None
    """The USB path of its socket, such as "1-1.4"; with the interface behind it where it has several ports."""
    description: str = field(compare=False)

    @property
    def identity(self) -> tuple[int | str | None, ...]:
        """What no other adapter has."""
        if self.serial_number is None:
            return self.vendor, self.product, self.location
        return self.vendor, self.product, self.serial_number, (self.location or "").partition(":")[2]

    def __str__(self) -> str:
        if self.serial_number is None:
            return f"{self.description} at USB path {self.location}"
        return f"{self.description}, serial number {self.serial_number}"


def adapter_at(path: str) -> Adapter | None:
    """The adapter of a port; None where the system knows none, as for a built-in port."""
    there = _adapters()
    adapter = there.pop(os.path.realpath(path), None)
    if adapter is not None and any(other.identity == adapter.identity for other in there.values()):
        # Cheap ones all bear the same number.
        return replace(adapter, serial_number=None)
    return adapter


def find_again(adapter: Adapter, path: str) -> str:
    """The path of the port that the adapter has now.

    Args:
        adapter: what was at `path` when it was opened for the first time.
        path: where it was.

    Raises:
        PortNotFound: it is not there, whatever else may be.
    """
    there = _adapters()
    same = [at for at, other in there.items() if _is_same(adapter, other)]
    if len(same) > 1:
        same = [at for at in same if there[at].location == adapter.location]
    if len(same) == 1:
        return path if os.path.realpath(path) == same[0] else same[0]
    other = there.get(os.path.realpath(path))
    if other is None:
        raise PortNotFound(f"{path} is not there any more: plug the same adapter in again ({adapter}).")
    raise PortNotFound(
        f"{path} is another adapter now ({other}); the bus was opened on {adapter}. Plug that one in again. If the "
        "other one hangs on the same pair, close the bus and open it anew."
    )


def _is_same(adapter: Adapter, other: Adapter) -> bool:
    return adapter.identity == (other if adapter.serial_number else replace(other, serial_number=None)).identity


def plugged_in() -> list[ListPortInfo]:
    """The serial ports that are there, as far as the system tells."""
    try:
        return list(list_ports.comports())
    except (OSError, TypeError, ValueError):  # one was pulled out while it was looked at
        return []


def _adapters() -> dict[str, Adapter]:
    """The adapters that are plugged in, by the real paths of their ports."""
    return {
        os.path.realpath(port.device): Adapter(
            port.vid, port.pid, port.serial_number or None, port.location, port.description
        )
        for port in plugged_in()
        if port.serial_number or (port.vid is not None and port.location)
    }
