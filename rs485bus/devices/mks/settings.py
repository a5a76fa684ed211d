"""What an MKS drive can be set to, and what that costs. Source: MKS RTU V1.0.9, the section named at each setting.

Settings can only be written. What a drive acknowledged is all that is ever known of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Final

from rs485bus.arguments import choice, instance
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import current, write, write_block
from rs485bus.devices.mks.homing import Homing, homing_frames
from rs485bus.devices.mks.values import EnableLevel, HoldingCurrent, Level, Model, ParameterDirection, WorkMode
from rs485bus.errors import NotSupported
from rs485bus.motion.settings import Cost, Setting
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Block, Register


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of a controller (3.3), each 0..1024. The motors come tuned: change them with care."""

    kp: int
    ki: int
    kd: int
    kv: int


VFOC_GAINS: Final = Gains(220, 100, 270, 320)
"""As shipped (3.3.1)."""
CLOSE_GAINS: Final = Gains(200, 80, 250, 300)
"""As shipped (3.3.2)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionProtection:
    """Let go of the shaft where it is off by so much for so long (3.4.2)."""

    turns: float
    """0..2.34, in steps of 1/28000."""
    seconds: float
    """0..983.025, in steps of about 0.015."""
    enabled: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class PulseDivider:
    """Toggle OUT_2 every so many pulses (4.3). 57D only."""

    period: int
    """100..4294967295 pulses; less turns it off."""
    start: Level = Level.LOW
    """The level with which it begins."""


Frames = Callable[[int, Model, Any], list[Request]]
MksSetting = Setting[[int, Model, Any]]


@dataclass(frozen=True, slots=True)
class _InRegister:
    """Writes a setting that is one register."""

    register: Register[Any]

    def __call__(self, address: int, model: Model, value: Any) -> list[Request]:
        return [write(address, self.register, value)]


def plain(name: str, value: Any) -> Any:
    """A setting as its drive is told it: what is reckoned with later is no `Decimal` and no scalar of numpy.

    Raises:
        LimitExceeded: it is out of its range.
    """
    frames = SETTINGS[name].frames
    return frames.register.decode(frames.register.encode(value)) if isinstance(frames, _InRegister) else value


def _gains(block: Block) -> Frames:
    def frames(address: int, model: Model, gains: Gains) -> list[Request]:
        instance("gains", gains, Gains, "Gains(220, 100, 270, 320)")
        return [write_block(address, block, gains.kp, gains.ki, gains.kd, gains.kv)]

    return frames


def _position_protection(address: int, model: Model, wanted: PositionProtection) -> list[Request]:
    instance("position protection", wanted, PositionProtection, "PositionProtection(turns=0.1, seconds=0.3)")
    return [write_block(address, r.POSITION_PROTECTION, 0, wanted.enabled, wanted.seconds, wanted.turns)]


def _pulse_divider(address: int, model: Model, divider: PulseDivider) -> list[Request]:
    check_outputs(model)
    instance("pulse divider", divider, PulseDivider, "PulseDivider(period=3200)")
    return [write_block(address, r.PULSE_DIVIDER, divider.start, divider.period)]


def check_outputs(model: Model) -> None:
    """Raise `NotSupported` for a drive without outputs."""
    if not model.has_outputs:
        raise NotSupported(f"A SERVO{model.value} has neither OUT_1 nor OUT_2; only the 57D does (1.2).")


_KEPT, _STANDING = Cost.KEPT, Cost.STANDING

SETTINGS: Final[dict[str, MksSetting]] = {
    "mode": Setting("work mode", "3.2.2", _KEPT | _STANDING, _InRegister(r.WORK_MODE)),
    "current": Setting(
        "working current", "3.2.3", _KEPT, lambda address, model, ma: [current(address, model, ma, save=True)]
    ),
    "holding_current": Setting("holding current", "3.2.4", _KEPT, _InRegister(r.HOLDING_CURRENT)),
    "microsteps": Setting("microsteps", "3.2.5", _KEPT | _STANDING, _InRegister(r.MICROSTEPS)),
    "enable_level": Setting("level of En", "3.2.6", _KEPT, _InRegister(r.ENABLE_LEVEL)),
    "pulse_direction": Setting("direction for pulses", "3.2.7", _KEPT, _InRegister(r.PULSE_DIRECTION)),
    "screen_off": Setting("automatic screen-off", "3.2.8", _KEPT, _InRegister(r.SCREEN_OFF)),
    "interpolation": Setting("interpolation", "3.2.9", _KEPT, _InRegister(r.INTERPOLATION)),
    "key_lock": Setting("key lock", "3.2.13", _KEPT, _InRegister(r.KEY_LOCK)),
    "vfoc_gains": Setting(
        "gains of the vFOC modes",
        "3.3.1",
        _KEPT | _STANDING,
        _gains(r.PID_VFOC),
    ),
    "close_gains": Setting(
        "gains of the CLOSE modes",
        "3.3.2",
        _KEPT | _STANDING,
        _gains(r.PID_CLOSE),
    ),
    "overcurrent_protection": Setting("overcurrent protection", "3.4.1", _KEPT, _InRegister(r.STALL_PROTECTION)),
    "position_protection": Setting("position error protection", "3.4.2", _KEPT, _position_protection),
    "pulse_divider": Setting("pulse divider", "4.3", _KEPT, _pulse_divider),
    "limit_remap": Setting("limit remapping", "5.3.1", _KEPT | _STANDING | Cost.HOMING, _InRegister(r.LIMIT_REMAP)),
    "homing": Setting(
        "homing",
        "5.3.2, 5.3.3, 5.3.4",
        _KEPT | _STANDING | Cost.HOMING | Cost.SLOW,
        homing_frames,
    ),
}
"""All settings of a profile, by the name of its field."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MksProfile:
    """Settings to write together, in this order. None leaves one alone.

    Ranges are those of the methods of `MksServo` that set one each.
    """

    mode: WorkMode | None = None
    current: int | None = None
    """mA."""
    holding_current: HoldingCurrent | None = None
    microsteps: int | None = None
    enable_level: EnableLevel | None = None
    pulse_direction: ParameterDirection | None = None
    screen_off: bool | None = None
    interpolation: bool | None = None
    key_lock: bool | None = None
    vfoc_gains: Gains | None = None
    close_gains: Gains | None = None
    overcurrent_protection: bool | None = None
    position_protection: PositionProtection | None = None
    pulse_divider: PulseDivider | None = None
    limit_remap: bool | None = None
    homing: Homing | None = None

    def __post_init__(self) -> None:
        if self.mode is not None:
            object.__setattr__(self, "mode", choice("mode", self.mode, WorkMode))

    def values(self) -> dict[str, Any]:
        """The settings that it holds, by name."""
        return {
            field.name: getattr(self, field.name) for field in fields(self) if getattr(self, field.name) is not None
        }

    def differences(self, acknowledged: MksProfile) -> dict[str, tuple[Any, Any]]:
        """Where a drive did not acknowledge what this says: the value here, and the one acknowledged or None.

        `axis.acknowledged` is what the drive has acknowledged; what it was set to before nobody can tell.
        """
        return {
            name: (value, getattr(acknowledged, name))
            for name, value in self.values().items()
            if getattr(acknowledged, name) != value
        }
