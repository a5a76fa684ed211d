"""What the plans of a ZLAC8015D know of it, and find out. Pure."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Protocol

from rs485bus.bus.units.motion import Motion
from rs485bus.devices.zlac.ability import ZlacAbility, ZlacOptions
from rs485bus.devices.zlac.memory import ZlacMemory
from rs485bus.devices.zlac.values import ControlMode
from rs485bus.motion.state import DriveState
from rs485bus.wire.frames import Request


@dataclass(frozen=True, slots=True, kw_only=True)
class ZlacSetup:
    """What was found at connect."""

    version: int
    """Of its software (0x20A0)."""
    counts_per_turn: tuple[int, int]
    """Left and right: four to an encoder line (0x2030, 0x2060)."""
    speed_resolution: int
    """Steps to one rpm (0x2022)."""
    speed_limit: float
    """rpm: the least of what was asked for, 0x2008 and 3000."""
    watchdog: int
    """ms (0x2000); 0 is off."""
    remarks: tuple[str, ...]
    """What differed from what was asked for, or is better known. It was logged, too."""


class KnownZlac(Protocol):
    """A drive, as its plans see it. `ZlacDrive` says what each of these is."""

    name: str
    address: int
    motion: Motion
    state: DriveState
    memory: ZlacMemory
    options: ZlacOptions
    abilities: tuple[ZlacAbility, ...]
    now: Callable[[], float]
    accelerations: dict[int, float | None]
    fault_remedy: str
    paused: bool
    ready: bool
    setup: ZlacSetup | None

    @property
    def enabled(self) -> bool: ...

    @property
    def is_in_emergency_stop(self) -> bool: ...

    @property
    def mode(self) -> ControlMode | None: ...

    def learn(self, counts: Sequence[int]) -> None: ...

    def keep(self, axis: int, mode: ControlMode | None, acceleration: float | None = None) -> None: ...

    def kept(self, axis: int) -> ControlMode | None: ...

    def start_word(self, axes: Collection[int]) -> Request: ...
