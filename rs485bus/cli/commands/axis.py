"""`rs485bus axis`."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from rs485bus.cli.options import (
    AxisBaudrate,
    BrokerUrl,
    BrokerUser,
    CaFile,
    DrivePort,
    Json,
    Mks,
    PasswordFile,
    Plant,
    Sim,
    Tlr,
    Watchdog,
    Zlac,
    where,
)

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

Value = Annotated[
    Optional[float],  # noqa: UP045 - typer reads it
    typer.Argument(help="The position, the distance or the speed (rpm), where the verb takes one."),
]
Number = Optional[float]  # noqa: UP045 - typer reads it


@app.command(context_settings={"ignore_unknown_options": True})
def axis(
    name: Annotated[str, typer.Argument(help="As in the plant file; with --port: mks5, tlr4, zlac3.left.")],
    verb: Annotated[
        str,
        typer.Argument(
            help="status, enable, disable, home, move-to, move-by, run, stop, emergency-stop, zero or clear-fault."
        ),
    ],
    value: Value = None,
    rpm: Annotated[Number, typer.Option(help="The speed of a move.")] = None,
    acceleration: Annotated[Number, typer.Option(help="rpm/s")] = None,
    duration: Annotated[Number, typer.Option(help="Seconds for which to run; without, until Ctrl-C.")] = None,
    timeout: Annotated[Number, typer.Option(help="Seconds that homing may take.")] = None,
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    watchdog: Watchdog = None,
    sim: Sim = False,
    json: Json = False,
    broker: BrokerUrl = None,
    user: BrokerUser = None,
    password_file: PasswordFile = None,
    ca: CaFile = None,
) -> None:
    """Have one axis do one thing, and wait until it is done.

    What moves enables the axis first, and guards it by its drive's watchdog, where it has one. Ctrl-C stops it.
    """
    from rs485bus.cli.axis import Order, run_order
    from rs485bus.cli.process import start

    order = Order(verb=verb, value=value, rpm=rpm, acceleration=acceleration, duration=duration, timeout=timeout)
    order.check()
    if broker is not None:
        from rs485bus.cli import over_broker

        served = over_broker.Served(broker, plant, user, password_file, ca)
        start(lambda: over_broker.run_order(served, name, order, json))
    there = where(plant, port, baudrate, mks, tlr, zlac, sim, watchdog)
    start(lambda: run_order(there, name, order, json))
