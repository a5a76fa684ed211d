"""`rs485bus estop`."""

from __future__ import annotations

from rs485bus.cli.options import AxisBaudrate, DrivePort, Json, Mks, Plant, Sim, Tlr, Zlac, where


def estop(
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    sim: Sim = False,
    json: Json = False,
) -> None:
    """Stop every drive as fast as it can, and say which were seen to stand."""
    from rs485bus.cli.axis import stop_all
    from rs485bus.cli.process import start

    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: stop_all(there, json))
