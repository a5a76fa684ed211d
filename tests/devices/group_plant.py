"""Drives of all families on virtual lines, as one group, on a virtual clock."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

from rs485bus import AxisGroup, Bus, BusConfig, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.devices.axis import Axis
from rs485bus.sim import Machine, Noise, SimDevice, SimMks, SimTlr, SimZlac, TlrMachine, VirtualLine
from rs485bus.sim.motor import Motor

MKS, TLR, LEFT, RIGHT = "mks", "tlr", "left", "right"
"""The kinds of axes; left and right are wheels of one ZLAC8015D."""


class Plant:
    """A group, and what is behind it.

    Args:
        kinds: what each axis is; they are named a, b, c and so on.
        pairs: how many lines. The devices are dealt out to them.
        delay: seconds between a command and the start, of drives that have one.
    """

    def __init__(
        self,
        *kinds: str,
        pairs: int = 1,
        baudrate: int = 115200,
        noise: Noise | None = None,
        seed: int = 0,
        delay: float = 0.005,
    ) -> None:
        self.kinds = kinds
        self.sims: dict[str, SimDevice] = {}
        """By the names of the axes; both wheels have one."""
        self.motors: dict[str, Callable[[], Motor]] = {}
        devices: list[list[SimDevice]] = [[] for _ in range(pairs)]
        self.where: dict[str, int] = {}
        zlac: SimZlac | None = None
        for at, kind in enumerate(kinds):
            name, address = "abcdefgh"[at], at + 1
            if kind in (LEFT, RIGHT):
                if zlac is None:
                    zlac = SimZlac(address)
                    devices[at % pairs].append(zlac)
                    self._zlac_at = at % pairs
                sim: SimDevice = zlac
                self.where[name] = self._zlac_at
                wheel = zlac.left if kind == LEFT else zlac.right
                self.motors[name] = lambda wheel=wheel: wheel.motor
            else:
                drive = (
                    SimMks(address, machine=Machine(start_delay=delay))
                    if kind == MKS
                    else SimTlr(address, machine=TlrMachine(start_delay=delay))
                )
                devices[at % pairs].append(drive)
                self.where[name] = at % pairs
                self.motors[name] = lambda drive=drive: drive.motion.motor
                sim = drive
            self.sims[name] = sim
        self.lines = [VirtualLine(*each, baudrate=baudrate, noise=noise or Noise(), seed=seed) for each in devices]
        self.buses: list[Bus] = []
        self.axes: dict[str, Axis] = {}

    @property
    def now(self) -> float:
        return asyncio.get_running_loop().time()

    @property
    def group(self) -> AxisGroup:
        return AxisGroup(**self.axes)

    def make_axes(self, **options: Any) -> None:
        zlac: Zlac8015d | None = None
        for (name, sim), kind in zip(self.sims.items(), self.kinds, strict=True):
            bus = self.buses[self.where[name]]
            if kind in (LEFT, RIGHT):
                zlac = zlac or Zlac8015d(bus, sim.address)
                self.axes[name] = zlac.left if kind == LEFT else zlac.right
            else:
                self.axes[name] = (MksServo if kind == MKS else TlrStepper)(bus, sim.address)

    def moving(self, name: str) -> bool:
        return self.motors[name]().moving(self.now)

    def stands(self) -> bool:
        return not any(self.moving(name) for name in self.motors)

    def turns(self, name: str) -> float:
        return self.motors[name]().position(self.now)

    def arrivals(self) -> dict[str, float]:
        """When each motor ends what it was told last."""
        return {name: motor().arrives_at for name, motor in self.motors.items()}

    def moves(self, name: str) -> int:
        """How often it was set in motion."""
        sim = self.sims[name]
        if isinstance(sim, SimZlac):
            return sim.moves[self.kinds["abcdefgh".index(name)] == RIGHT]
        assert isinstance(sim, SimMks | SimTlr)
        return sim.motion.moves


@asynccontextmanager
async def plant(
    *kinds: str, config: BusConfig | None = None, enabled: bool = True, **options: Any
) -> AsyncIterator[Plant]:
    """A group of such axes, enabled unless they are not to be."""
    made = Plant(*kinds, **options)
    async with AsyncExitStack() as stack:
        for line in made.lines:
            made.buses.append(await stack.enter_async_context(open_bus(line, config=config or BusConfig())))
        made.make_axes()
        if enabled:
            await made.group.enable()
        yield made
    assert not any(line.pair.early_frames for line in made.lines)
