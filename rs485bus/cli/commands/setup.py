"""`rs485bus setup`."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from rs485bus.cli.options import Sim, Yes

# typer reads these at run time.
Whole = Optional[int]  # noqa: UP045
Text = Optional[str]  # noqa: UP045


def setup(
    port: Annotated[Text, typer.Argument(help="A serial port, or a gateway: socket://host:port, tcp://host.")] = None,
    new_address: Annotated[
        Whole, typer.Option(min=1, max=247, help="What it is to have; without, you are asked.")
    ] = None,
    new_baudrate: Annotated[Whole, typer.Option(min=300, help="bit/s it is to have.")] = None,
    address: Annotated[Whole, typer.Option(min=1, max=247, help="What it has; without, it is looked for.")] = None,
    baudrate: Annotated[Whole, typer.Option("--baudrate", "-b", min=300, help="bit/s it has.")] = None,
    modbus_on: Annotated[bool, typer.Option(help="First have an MKS drive speak Modbus that does not yet.")] = False,
    yes: Yes = False,
    sim: Sim = False,
) -> None:
    """Give a new drive, alone on the pair, its address and its baud rate.

    It is looked for where it is not said to be. What it is to have is asked where it is not said; --yes asks nothing.
    """
    from rs485bus.cli.process import start
    from rs485bus.cli.setup import SetUp

    work = SetUp(
        port=port,
        address=address,
        baudrate=baudrate,
        new_address=new_address,
        new_baudrate=new_baudrate,
        modbus_on=modbus_on,
        yes=yes,
        sim=sim,
    )
    work.check()
    start(work.run, virtual=sim)
