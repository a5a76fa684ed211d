"""`rs485bus ports`."""

from __future__ import annotations

from rs485bus.cli.options import Json


def ports(json: Json = False) -> None:
    """List the serial ports: what is plugged in, who holds it, and what slows it down."""
    from rs485bus.cli.find import show_ports

    show_ports(json)
