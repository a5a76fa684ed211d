"""`rs485bus estop`."""

from __future__ import annotations

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
    Zlac,
    where,
)


def estop(
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    sim: Sim = False,
    json: Json = False,
    broker: BrokerUrl = None,
    user: BrokerUser = None,
    password_file: PasswordFile = None,
    ca: CaFile = None,
) -> None:
    """Stop every drive as fast as it can, and say which were seen to stand."""
    from rs485bus.cli.axis import stop_all
    from rs485bus.cli.process import start

    if broker is not None:
        from rs485bus.cli import over_broker

        served = over_broker.Served(broker, plant, user, password_file, ca)
        start(lambda: over_broker.stop_all(served, json))
    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: stop_all(there, json))
