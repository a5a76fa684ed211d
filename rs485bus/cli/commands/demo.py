"""`rs485bus demo`."""

from __future__ import annotations

from rs485bus.cli.options import Baudrate, Mks, Port, check_once

_USUAL = [1, 2, 3]


def demo(port: Port = None, baudrate: Baudrate = 38400, mks: Mks = None) -> None:
    """Home some drives, move them, watch them, stop: on a virtual plant, or on real drives."""
    from rs485bus.cli.demo import run_demo
    from rs485bus.cli.process import console, start

    addresses = mks or _USUAL
    check_once(addresses)
    start(lambda: run_demo(port, baudrate, addresses, console()))
