"""What a drive is set to, as a table of names and values, whatever its family: read, written, compared.

MKS drives cannot be asked for their settings. Of these it is known only what they have acknowledged; a settings file
keeps that with its values.
"""

from __future__ import annotations

import dataclasses
import enum
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from typing import Any, get_args, get_type_hints

from rs485bus.devices import mks, tlr, zlac
from rs485bus.errors import NotSupported
from rs485bus.plant.problems import instead
from rs485bus.wire.registers import Register

_ROUNDING = 1e-6

Values = dict[str, Any]
"""Settings by name, as TOML holds them."""


class DriveSettings(ABC):
    """The settings of one drive."""

    readable = True
    """Whether the drive can be asked for them."""

    @abstractmethod
    def names(self) -> Mapping[str, str]:
        """All settings, with what each is: "mA, 0..5200"."""

    @abstractmethod
    async def read(self, names: Iterable[str] | None = None) -> Values:
        """What some or all are set to. Raises `NotSupported` where the drive cannot be asked."""

    @abstractmethod
    async def write(self, values: Values) -> None:
        """Set some, and have the drive keep them. Raises `LimitExceeded` before anything is sent, where one is none."""

    @abstractmethod
    def check_values(self, values: Values) -> None:
        """Refuse what some cannot be set to. Raises as `write`."""

    def check(self, names: Iterable[str]) -> None:
        """Raise `NotSupported` for a setting that the drive does not have."""
        known = self.names()
        for name in names:
            if name not in known:
                raise NotSupported(f"There is no setting {name!r}{instead(name, known)}")


def settings_of(facade: Any) -> DriveSettings:
    """The settings of a drive by its facade.

    Raises:
        NotSupported: its family has none here.
    """
    if isinstance(facade, mks.MksServo):
        return MksSettings(facade)
    if isinstance(facade, zlac.Zlac8015d):
        return ZlacSettings(facade)
    if isinstance(facade, tlr.TlrStepper):
        return TlrSettingsTable(facade)
    raise NotSupported(f"The settings of {facade!r} are not known here: rs485bus read and write reach any register.")


def differences(wanted: Values, found: Values) -> dict[str, tuple[Any, Any]]:
    """Where two tables differ, by name: the value in the first and the one in the second, None for none."""
    return {name: (value, found.get(name)) for name, value in wanted.items() if not _same(value, found.get(name))}


def _same(one: Any, other: Any) -> bool:
    """Whether a value is as wanted. Of a table, what is not said may be anything."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return all(_same(value, other.get(key)) for key, value in one.items())
    if isinstance(one, float) and isinstance(other, int | float):
        return abs(one - other) < _ROUNDING * (1 + abs(one))
    return bool(one == other)


def slug(name: str) -> str:
    """A name as a key."""
    return re.sub(r"\W+", "_", name.lower()).strip("_")


# Registers


class RegisterSettings(DriveSettings):
    """Settings that are registers."""

    def __init__(self, registers: Iterable[Register[Any]]) -> None:
        self._registers = {slug(register.name): register for register in registers}

    def names(self) -> Mapping[str, str]:
        return {name: _kind(register) for name, register in self._registers.items()}

    async def read(self, names: Iterable[str] | None = None) -> Values:
        wanted = list(self._registers) if names is None else list(names)
        self.check(wanted)
        return {name: _plain(await self._ask(self._registers[name])) for name in wanted}

    def check_values(self, values: Values) -> None:
        self._checked(values)

    def _checked(self, values: Values) -> Values:
        """What is to be written, each of the register's own type."""
        self.check(values)
        typed = {name: _typed(self._registers[name], value) for name, value in values.items()}
        for name, value in typed.items():
            self._registers[name].encode(value)  # raises what is out of range
        return typed

    async def write(self, values: Values) -> None:
        for name, value in self._checked(values).items():
            await self._tell(self._registers[name], value)
        await self._keep()

    @abstractmethod
    async def _ask(self, register: Register[Any]) -> Any:
        """What a register holds."""

    @abstractmethod
    async def _tell(self, register: Register[Any], value: Any) -> None:
        """Write it."""

    async def _keep(self) -> None:
        """Have the drive keep what was written."""


class ZlacSettings(RegisterSettings):
    """The parameters of a ZLAC8015D and of its two motors."""

    def __init__(self, drive: zlac.Zlac8015d) -> None:
        r = zlac.registers
        sides = (register for twin in r.PARAMETERS for register in (twin.left, twin.right))
        quick = (r.QUICK_STOP_TIME.left, r.QUICK_STOP_TIME.right)
        common = (
            *(r.POWER_ON_SHAFT, r.SPEED_LIMIT, r.CAN_NODE_ID, r.CAN_BIT_RATE, r.PARKING, r.INPUTS_REVERSED),
            *(r.X0_FUNCTION, r.X1_FUNCTION, r.OUTPUTS_REVERSED, r.Y0_FUNCTION, r.Y1_FUNCTION),
            *(r.DRIVE_TEMPERATURE_LIMIT, r.ALARM_SHORT_CIRCUIT, r.OVERLOAD_PROCESSING, r.EMERGENCY_SHAFT),
            r.SPEED_RESOLUTION,
        )
        super().__init__((*common, *quick, *sides))
        self._drive = drive

    async def _ask(self, register: Register[Any]) -> Any:
        return await self._drive.parameter(register)

    async def _tell(self, register: Register[Any], value: Any) -> None:
        await self._drive.set_parameter(register, value, save=True)


class TlrSettingsTable(RegisterSettings):
    """The parameters of a TL-R, without those that `setup` changes and those of each move."""

    def __init__(self, stepper: tlr.TlrStepper) -> None:
        r = tlr.registers
        others = {r.STATION, r.SERIAL_FORMAT, r.BAUD_RATE, r.FORCED_OUTPUTS, *r.POSITIONING.fields, *r.JOG.fields}
        super().__init__(register for register in r.SETTINGS if register not in others)
        self._stepper = stepper

    async def _ask(self, register: Register[Any]) -> Any:
        return await self._stepper.read(register)

    async def _tell(self, register: Register[Any], value: Any) -> None:
        r, stepper = tlr.registers, self._stepper
        if register is r.SUBDIVISION:
            await stepper.set_subdivision(value)
        elif register is r.DIRECTION:
            await stepper.set_direction(reverse=value)
        elif register in r.INPUT_FUNCTIONS:
            await stepper.bus.unit(stepper.address).write(register, value)
        else:
            await stepper.write(register, value)

    async def _keep(self) -> None:
        await self._stepper.save()


def _kind(register: Register[Any]) -> str:
    into: Any = register.into
    chosen = isinstance(into, enum.EnumType) and not issubclass(into, enum.Flag)
    if chosen:
        return ", ".join(into.__members__)
    if into is bool:
        return "true or false"
    low = register.number.low if register.low is None else register.low
    high = register.number.high if register.high is None else register.high
    return f"{low:g}..{high:g}{' ' + register.unit if register.unit else ''}"


def _plain(value: Any) -> Any:
    if isinstance(value, enum.Flag):
        return int(value.value)
    return value.name if isinstance(value, enum.Enum) else value


def _typed(register: Register[Any], value: Any) -> Any:
    into: Any = register.into
    if isinstance(into, enum.EnumType):
        return _member(into, register.name, value)
    if into is bool and not isinstance(value, bool):
        raise NotSupported(f"{slug(register.name)} is true or false, not {value!r}")
    if isinstance(value, str | bool) and into is not bool:
        raise NotSupported(f"{slug(register.name)} is a number ({_kind(register)}), not {value!r}")
    return value


def _member(kind: Any, name: str, value: Any) -> Any:
    if isinstance(value, str) and not issubclass(kind, enum.Flag):
        try:
            return kind[value.upper()]
        except KeyError:
            names = ", ".join(member.name for member in kind)
            raise NotSupported(f"{slug(name)} is one of {names}, not {value!r}") from None
    return kind(value)


# MKS

_EXAMPLES = {
    "mode": '"SR_VFOC"',
    "current": "1600",
    "microsteps": "16",
    "vfoc_gains": "{ kp = 220, ki = 100, kd = 270, kv = 320 }",
    "close_gains": "{ kp = 200, ki = 80, kd = 250, kv = 300 }",
    "position_protection": "{ turns = 1.0, seconds = 0.3 }",
    "pulse_divider": "{ period = 1000 }",
    "homing": '{ kind = "switch", direction = "CW", rpm = 60 }',
}
_HOMINGS = {"switch": mks.SwitchHoming, "stop": mks.StopHoming, "single_turn": mks.SingleTurnHoming}


class MksSettings(DriveSettings):
    """The settings of an MKS drive, which can only be written."""

    readable = False

    def __init__(self, servo: mks.MksServo) -> None:
        self._servo = servo
        self._hints = get_type_hints(mks.MksProfile)

    def names(self) -> Mapping[str, str]:
        return {name: f"{setting.title} ({setting.section})" for name, setting in mks.SETTINGS.items()}

    async def read(self, names: Iterable[str] | None = None) -> Values:
        raise NotSupported(
            f"{self._servo.name}: an MKS drive cannot be asked for its settings; its menu shows them. What it has "
            "acknowledged is kept in the file that was loaded: rs485bus settings load NAME FILE, then diff NAME FILE."
        )

    def check_values(self, values: Values) -> None:
        self._servo.check_profile(self._profile(values))

    def _profile(self, values: Values) -> mks.MksProfile:
        self.check(values)
        return mks.MksProfile(**{name: self._value(name, value) for name, value in values.items()})

    async def write(self, values: Values) -> None:
        await self._servo.write_profile(self._profile(values))

    @property
    def acknowledged(self) -> Values:
        """What the drive has acknowledged."""
        return {name: _table(value) for name, value in self._servo.acknowledged.values().items()}

    def template(self) -> str:
        """All settings as lines of a file, each with an example, and a # before it."""
        lines = []
        for name, what in self.names().items():
            example = _EXAMPLES.get(name)
            if example is None:
                kind = next(part for part in get_args(self._hints[name]) if part is not type(None))
                example = f'"{next(iter(kind.__members__))}"' if isinstance(kind, enum.EnumType) else "true"
            lines.append(f"# {name} = {example}   # {what}")
        return "\n".join(lines)

    def _value(self, name: str, value: Any) -> Any:
        if name == "homing":
            return _homing(value)
        kind = next(part for part in get_args(self._hints[name]) if part is not type(None))
        return _made(name, kind, value)


def _homing(value: Any) -> Any:
    if not isinstance(value, Mapping) or value.get("kind") not in _HOMINGS:
        kinds = ", ".join(f'kind = "{kind}"' for kind in _HOMINGS)
        raise NotSupported(f"homing is a table that says which: {kinds}")
    rest = {key: part for key, part in value.items() if key != "kind"}
    return _made("homing", _HOMINGS[value["kind"]], rest)


def _made(name: str, kind: Callable[..., Any], value: Any) -> Any:
    """A value of a class from what TOML holds."""
    if dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        if not isinstance(value, Mapping) or not value.keys() <= hints.keys():
            raise NotSupported(f"{name} is a table with {', '.join(hints)}, not {value!r}")
        try:
            return kind(**{key: _made(f"{name}.{key}", hints[key], part) for key, part in value.items()})
        except TypeError as error:
            raise NotSupported(f"{name}: {error}") from None
    if isinstance(kind, enum.EnumType):
        return _member(kind, name, value)
    if kind is bool and not isinstance(value, bool):
        raise NotSupported(f"{name} is true or false, not {value!r}")
    if kind in (int, float) and (isinstance(value, bool) or not isinstance(value, int | float)):
        raise NotSupported(f"{name} is a number, not {value!r}")
    return value


def _table(value: Any) -> Any:
    """A value as TOML holds it."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        kind = [("kind", name) for name, made in _HOMINGS.items() if isinstance(value, made)]
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return {**dict(kind), **{name: _table(part) for name, part in fields.items() if part is not None}}
    return _plain(value)
