"""What a TL-R drive is set to. Source: TL-R manual, 2.2.4, 3.5.3, 3.5.6.

What is written holds until the drive is switched off, unless it was saved.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

from rs485bus.arguments import flag, instance, whole
from rs485bus.bus.handle import Handle
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.drive import TlrDrive
from rs485bus.devices.tlr.frames import read, words, write
from rs485bus.devices.tlr.parameters import TlrParameters
from rs485bus.devices.tlr.values import Auxiliary, BaudRate, LimitStop, OperatingMode, SerialFormat
from rs485bus.errors import AddressInUse, DeviceRefused, NoReply, NotSupported, ReferenceLost
from rs485bus.motion.axis import Axis
from rs485bus.motion.diagnosis import LOST
from rs485bus.motion.plan import Ask, MustStand, Pause, Plan, Stand
from rs485bus.wire.frames import MAX_ADDRESS
from rs485bus.wire.registers import Field, Register, Repeat

T = TypeVar("T")

_GUARDED = frozenset(register.address for register in r.MANUFACTURER)
_VERBS: dict[Register[Any] | Field[Any], str] = {
    r.STATION: "set_station()",
    r.BAUD_RATE: "set_baudrate()",
    r.SERIAL_FORMAT: "set_serial_format()",
    r.SUBDIVISION: "set_subdivision()",
    r.DIRECTION: "set_direction()",
    **dict.fromkeys(r.INPUT_FUNCTIONS, "inputs"),
    **dict.fromkeys(r.POSITIONING.fields, "move_to()"),
}
"""What there is a verb for, because more depends on it."""
_ROUNDS = (0.0, 0.5)
"""Seconds before each round of questions whether somebody is there: one more, and the bus would take it for offline."""
_FREE = frozenset(register.address for register in r.SETTINGS if register not in _VERBS)


class TlrSetup(Axis):
    """Settings. Each joins the queue and returns a handle. What is written is read back.

    Every method raises `LimitExceeded` for a value out of its range, before anything is queued. The handle raises what
    a request can end in (`DeviceRefused`, `NoReply`, ...).
    """

    _tlr: TlrDrive
    _parameters: TlrParameters

    # Limits

    def set_soft_limits(self, low: float | None = None, high: float | None = None) -> Handle[None]:
        """Let the drive itself stop at two positions, in units of the axis; without them it does so no more.

        They count only once the drive was homed since it was switched on (3.5.3).

        Raises:
            ValueError: one of them is missing, or the higher one comes first.
        """
        if low is None or high is None:
            if low is not high:
                raise ValueError("set_soft_limits takes both limits, or none to turn them off")
            return self._parameters.put(r.SOFT_LIMITS_ON, False)
        ends = self._number("soft limit", low), self._number("soft limit", high)
        if ends[0] > ends[1]:
            raise ValueError(f"soft limits {low:g}..{high:g} are the wrong way round")

        def plan() -> Plan[None]:
            negative, positive = sorted(map(self._to_counts, ends))
            yield from self._tlr.writer.put(r.SOFT_LIMITS, positive, negative)
            yield from self._tlr.writer.put(r.SOFT_LIMITS_ON, True)

        return self._parameters.order(f"soft limits {low:g}..{high:g}", plan)

    def set_limit_stop(self, how: LimitStop) -> Handle[None]:
        """What a limit switch does to the motor."""
        return self._parameters.put(r.LIMIT_STOP, how)

    # Counting

    def set_subdivision(self, pulses: int) -> Handle[None]:
        """Pulses a turn: 400..51200. Positions then mean something else: home the axis, or set its zero.

        It holds from then on, whatever `pulses_per_turn` the axis was made with.
        """
        r.SUBDIVISION.encode(pulses)

        def plan() -> Plan[None]:
            self._tlr.pulses_per_turn = None  # it is asked for before the next command
            yield Stand()
            yield from self._tlr.writer.put(r.SUBDIVISION, pulses)

        return self._parameters.order(f"{r.SUBDIVISION.name} = {pulses}", plan)

    def set_direction(self, *, reverse: bool) -> Handle[None]:
        """Which way the shaft turns. Positions then mean something else: home the axis, or set its zero."""
        r.DIRECTION.encode(reverse)

        def plan() -> Plan[None]:
            yield Stand()
            yield from self._tlr.writer.put(r.DIRECTION, reverse)

        return self._parameters.order(f"{r.DIRECTION.name} = {reverse}", plan)

    # The line. The DIP switches must allow for it: SW1 to SW4 off for the station, SW5 on for the baud rate.

    def set_station(self, unit: int) -> Handle[None]:
        """Its address while SW1 to SW4 are off: 1..247 (the manual has 0 to 254; Modbus ends at 247).

        Whether it counts at once or after `save()` and a power cycle is not said. Make a new `TlrStepper` for it then.
        If the answer is lost, `OutcomeUnknown` is raised: ask for it at both addresses.

        Raises:
            AddressInUse: there is a facade for that address on this bus; or, when awaited, somebody answers there. Two
                drives at one address cannot be told apart any more, and both do what one is told. Nothing is changed.
            NotStanding: when awaited: the motor turns.
        """
        station = whole("station", unit, 1, MAX_ADDRESS)
        if station == self._tlr.address:
            return self._reach_by(r.STATION, station)
        if any(device.address == station for device in self.bus.devices):
            raise AddressInUse(f"{self.name}: address {station} has a facade on this bus already: name a free one.")

        def check_free() -> Plan[None]:
            for pause in _ROUNDS:  # some of its replies may be lost, or late
                yield Pause(pause)
                with suppress(NoReply):
                    with suppress(DeviceRefused):
                        yield Ask(read(station, r.STATION))
                    raise AddressInUse(f"{self.name}: somebody answers at address {station} already: name a free one.")

        return self._reach_by(r.STATION, station, check_free)

    def set_baudrate(self, baudrate: BaudRate) -> Handle[None]:
        """Its baud rate while SW5 is on. When it counts is not said, as for `set_station`; open the bus at it then."""
        return self._reach_by(r.BAUD_RATE, baudrate)

    def set_serial_format(self, serial_format: SerialFormat) -> Handle[None]:
        """Its parity and stop bits. When they count is not said, as for `set_station`; open the bus with them then."""
        return self._reach_by(r.SERIAL_FORMAT, serial_format)

    # All of it

    def save(self) -> Handle[None]:
        """Have the drive keep what it is set to when it is switched off. Raises `ReferenceLost` if it restarts then."""

        def plan() -> Plan[None]:
            # What is saved must not be what is written next: else a restart could not be told.
            yield from self._tlr.put_nothing(unlike=0)
            yield from self._tlr.writer.auxiliary(Auxiliary.SAVE)
            if (yield from self._tlr.put_nothing(unlike=1)):
                raise ReferenceLost(
                    f"{self._tlr.name} has restarted meanwhile: set again what was set, save() that, then {LOST}"
                )

        return self._parameters.order("save", plan)

    def factory_reset(self) -> Handle[None]:
        """Set everything as it was shipped, the station and the baud rate too.

        The axis then needs `enable()`, and `home()` or `set_zero()`. Raises `OutcomeUnknown` if the answer is lost.
        """

        def plan() -> Plan[None]:
            yield Stand()
            yield from self._tlr.writer.auxiliary(Auxiliary.FACTORY_RESET, Repeat.NEVER)

        return self._parameters.order("factory reset", plan)

    def set_operating_mode(self, mode: OperatingMode) -> Handle[None]:
        """Whether its loop is closed. It counts after `save()` and a power cycle; TLO drives have no encoder."""
        return self._parameters.put(r.OPERATING_MODE, mode)

    # Anything else

    async def read(self, register: Register[T]) -> T:
        """Ask for any parameter: `await stepper.read(registers.INPUT_FILTER)`. Settings queued before are done then."""
        value: T = await self._parameters.ask(instance("register", register, Register, "registers.INPUT_FILTER"))
        return value

    def write(self, register: Register[T], value: T, *, manufacturer: bool = False) -> Handle[None]:
        """Write any parameter that is kept, and read it back.

        Args:
            register: of `rs485bus.devices.tlr.registers`.
            value: what it is to be.
            manufacturer: write a parameter that the manufacturer has set for the motor (3.5.6).

        Raises:
            LimitExceeded: the value is out of its range; nothing is queued.
            NotSupported: it is not to be written in this way; nothing is queued.
        """
        instance("register", register, Register, "registers.INPUT_FILTER")
        if not flag("manufacturer", manufacturer) and register.address in _GUARDED:
            raise NotSupported(
                f"{self.name}: {register.name} (0x{register.address:X}) is set by the manufacturer for the motor; a "
                "wrong value can damage both. Note what it reads, then write it with manufacturer=True."
            )
        if register.address not in _FREE | _GUARDED:
            raise NotSupported(
                f"{self.name}: {register.name} (0x{register.address:X}) is not written like that; for what can be, "
                f"there is {_VERBS.get(register, 'move_to(), run(), home(), stop(), enable(), set_zero(), save()')}."
            )
        return self._parameters.put(register, value)

    # Inside

    def _reach_by(
        self, register: Register[Any], value: Any, check: Callable[[], Plan[None]] | None = None
    ) -> Handle[None]:
        """Queue the writing of what the drive is reached by: once, and without reading it back. While it stands, for
        nothing might reach it to stop it."""
        values = words(register.encode(value))

        def plan() -> Plan[None]:
            yield MustStand(f"{register.name} = {value}")
            if check is not None:
                yield from check()
            yield Ask(write(self._tlr.address, register.address, values), repeat=Repeat.NEVER)

        return self._parameters.order(f"{register.name} = {value}", plan)
