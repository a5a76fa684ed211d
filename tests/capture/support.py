"""A cell of three families, a plain device, and what a bus and a listener make of it, in virtual time."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.bus.capture_lines import Entry, Exchange
from rs485bus.bus.record import Record
from rs485bus.capture.sniffer import Sniffer
from rs485bus.errors import BusError
from rs485bus.sim import Machine, Noise, SimMks, SimTlr, SimUnit, SimZlac, VirtualLine

BANK = {register: register for register in range(10)}


def cell(noise: Noise | None = None, seed: int = 0) -> VirtualLine:
    """MKS 1, ZLAC 3, TL-R 4 and a plain device 9."""
    drives = (SimMks(1, machine=Machine(home_switch=-1.0)), SimZlac(3), SimTlr(4), SimUnit(9, BANK))
    return VirtualLine(*drives, baudrate=115200, noise=noise or Noise(), seed=seed)


async def work(line: VirtualLine, records: list[Record], path: Path | None = None) -> None:
    """Home, move, run and stop, with a refused write among it. Fills in the records of the bus."""
    async with open_bus(line) as bus:
        bus.subscribe(records.append)
        recording = None if path is None else bus.record_to(path)
        x, base, y = MksServo(bus, 1), Zlac8015d(bus, 3), TlrStepper(bus, 4)
        async with bus.watchdog(x, base, timeout=1.0):
            for axis in (x, base.left, y):
                axis.enable()
            await x.home()
            moves = [x.move_to(1.5, rpm=300), y.move_to(1.0, rpm=200)]
            base.left.run(60)
            for value in range(10):
                await bus.unit(9).write_register(3, value)
                await bus.unit(9).read_holding_registers(0, 4)
            for move in moves:
                await move
            await base.left.stop()
            with contextlib.suppress(BusError):
                await bus.unit(9).write_register(40, 1)
        if recording is not None:
            recording.close()


class Listener:
    """A sniffer on a virtual line."""

    def __init__(self, line: VirtualLine) -> None:
        self.found: list[Entry] = []
        self.sniffer = Sniffer(line.line, self.found.append)
        line.listen(self.sniffer.feed)
        self._ticking = asyncio.ensure_future(self._tick())

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(0.02)
            self.sniffer.tick(asyncio.get_running_loop().time())

    async def finish(self) -> list[Exchange]:
        """Stop listening; return the exchanges."""
        await asyncio.sleep(1.5)
        self._ticking.cancel()
        self.sniffer.end(asyncio.get_running_loop().time())
        return [entry for entry in self.found if isinstance(entry, Exchange)]
