"""`rs485bus verify-watchdog`."""

from __future__ import annotations

from typing import Annotated

import typer

from rs485bus.cli.options import Baudrate, Port, Yes


def verify_watchdog(
    port: Port = None,
    baudrate: Baudrate = 38400,
    mks: Annotated[int, typer.Option("--mks", min=1, max=247, help="The address of the MKS drive.")] = 1,
    timeout: Annotated[float, typer.Option(min=0.2, max=60, help="The watchdog's time in the test, in seconds.")] = 1.0,
    yes: Yes = False,
) -> None:
    """Find out on the bench what feeds a drive's watchdog, and whether a trip latches. It turns the motor."""
    from rs485bus.cli.process import console, start
    from rs485bus.cli.verify import verify

    start(lambda: verify(port, baudrate, mks, timeout, yes, console()), virtual=port is None)
