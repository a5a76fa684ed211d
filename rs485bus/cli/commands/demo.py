"""`rs485bus demo`."""

from __future__ import annotations

from rs485bus.cli.options import AxisBaudrate, Mks, Plant, Port, Sim, Tlr, Zlac, where

_USUAL = [1, 2, 3]
_MKS_RATE, _OTHER_RATE = 38400, 115200


def demo(
    plant: Plant = None,
    port: Port = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    sim: Sim = False,
) -> None:
    """Home some drives, move them, watch them, stop: on a virtual plant, or on real drives.

    With --port, only drives that are named move.
    """
    from rs485bus.cli.demo import run_demo
    from rs485bus.cli.process import console, start

    if plant is None and port is None and not (mks or tlr or zlac):
        mks = _USUAL
    if plant is None and baudrate is None:
        baudrate = _OTHER_RATE if tlr or zlac else _MKS_RATE
    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: run_demo(there, console()))
