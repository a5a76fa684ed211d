"""TL-R integrated steppers as an axis. Source: TL-R manual, the section named at each method."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.arguments import flag, positive
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.alarms import Alarm, alarm_of
from rs485bus.devices.tlr.homing import TlrHoming
from rs485bus.devices.tlr.ports import Inputs, Outputs
from rs485bus.devices.tlr.settings import TlrSettings
from rs485bus.devices.tlr.tables import Paths, SpeedPaths
from rs485bus.devices.tlr.values import Auxiliary, Ports, StatusWord
from rs485bus.errors import DriveFault


@dataclass(frozen=True, slots=True)
class TlrStatus:
    """What a drive reports of itself, of one moment (3.5.1)."""

    word: StatusWord
    alarm: Alarm | None
    inputs: Ports
    outputs: Ports
    position: float
    """In units of the axis. Of an open loop that of the command, of a closed one that of the encoder."""
    rpm: float

    @property
    def in_position(self) -> bool:
        return StatusWord.IN_POSITION in self.word

    @property
    def homed(self) -> bool:
        """Soft limits count only if it is."""
        return StatusWord.HOMED in self.word

    @property
    def running(self) -> bool:
        return StatusWord.RUNNING in self.word

    @property
    def fault(self) -> bool:
        return StatusWord.FAULT in self.word

    @property
    def says_enabled(self) -> bool:
        """Bit 4. It is reported here and relied on nowhere, unless the axis was made with `enabled_bit=True`."""
        return StatusWord.ENABLED in self.word


@dataclass(frozen=True, slots=True)
class Version:
    """What the drive runs, and what it is made of."""

    software: int
    hardware: int


class TlrStepper(TlrHoming, TlrSettings):
    """A TL-R integrated stepper: TLC (closed loop) and TLO (open loop) 42, 57, 60 and 86.

    It has no watchdog, and does not notice when the host is gone: `watchdog()` raises `NotSupported`. Have a safety
    relay cut its power that something else watches. So that it ends by itself, a `run` for a time is a positioning.

    Whether its motor is held cannot be read reliably: it moves after `enable()` only, and after a restart only when
    that was done again. A restart shows in that 0x33 to 0x38 do not hold any more what was written to them.

    Args:
        bus: the bus it is on, as shipped at 115200, no parity.
        address: 1..247.
        pulses_per_turn: None for its subdivision (0x23), which it is asked for.
        units_per_turn: positions are in units of this many to a turn of the motor; 1 for turns.
        reverse: whether positive is the other way round. Which way the shaft then turns is not promised.
        limits: lowest and highest position that may be gone to, in units.
        rpm: the speed of moves that name none: 1..3000.
        acceleration: the acceleration of moves that name none, in rpm/s: at least half the speed in rpm, for ramps
            take 2 s at most; infinity for a jump.
        start_rpm: the speed at which moves begin: 0..3000.
        tolerance: pulses by which a position may differ from its target; None for 1/500 turn.
        clear_trigger: write 0 to the control word before what starts something. False saves a frame where the drive
            starts at each write (the manual says of some bits that they need no reset, of others that they must rise).
        block_writes: write what belongs together in one request. Some firmware keeps only a part of five registers or
            more; that is noticed, and they are written singly from then on. False to do so from the beginning.
        keeps_target: 0x33 to 0x38 hold what was written until the drive is switched off. False where a move uses them
            up: then only a jump of its position shows that a drive has restarted.
        enabled_bit: rely on status bit 4.
        live_jog: a jog under way takes another speed. False to stop it before.
        ramp_rpm: the speed that the times of ramps refer to; None for the speed of the move. The manual does not say.

    Raises:
        AddressInUse: there is a facade for this address already.
        LimitExceeded, ValueError: an argument is out of its range.
        TypeError: one is of a wrong type.
    """

    def __init__(
        self,
        bus: Bus,
        address: int,
        *,
        pulses_per_turn: int | None = None,
        units_per_turn: float = 1.0,
        reverse: bool = False,
        limits: tuple[float, float] | None = None,
        rpm: float = 300.0,
        acceleration: float = 2000.0,
        start_rpm: int = 0,
        tolerance: int | None = None,
        clear_trigger: bool = True,
        block_writes: bool = True,
        keeps_target: bool = True,
        enabled_bit: bool = False,
        live_jog: bool = False,
        ramp_rpm: float | None = None,
    ) -> None:
        self.start_rpm = r.START_SPEED.raw(start_rpm)
        self.live_jog = flag("live_jog", live_jog)
        self.ramp_rpm = None if ramp_rpm is None else positive("ramp_rpm", ramp_rpm)
        super().__init__(
            bus,
            address,
            pulses_per_turn=pulses_per_turn,
            units_per_turn=units_per_turn,
            reverse=reverse,
            limits=limits,
            rpm=rpm,
            acceleration=acceleration,
            tolerance=tolerance,
            clear_trigger=clear_trigger,
            block_writes=block_writes,
            keeps_target=keeps_target,
            enabled_bit=enabled_bit,
        )
        self.paths = Paths(self, self._to_counts, self._to_units)
        """Where inputs can send it: `paths[3] = Path(12.5, rpm=600)`, `await paths[3]`."""
        self.speed_paths = SpeedPaths(self, self._sign)
        """How fast inputs can turn it."""
        self.inputs = Inputs(self)
        """What the inputs do: `inputs[3] = DiFunction.STOP`."""
        self.outputs = Outputs(self)
        """What the outputs tell."""

    # Verbs

    def release(self) -> Handle[None]:
        """Let go of the shaft, once what is queued before it is done and the motor stands. The same as `disable`."""
        return self.disable()

    def clear_alarm(self) -> Handle[None]:
        """End an alarm whose cause is gone (3.6). The motor is held again after `enable()`.

        Raises:
            DriveFault: it is still there. It says what to do, and whether the drive must be switched off and on.
        """

        async def carry_out() -> None:
            await self.link.auxiliary(Auxiliary.CLEAR_ALARM)
            alarm = alarm_of(await self.link.read(r.ALARM))
            if alarm is not None:
                raise DriveFault(f"{self.name} still reports {alarm}.")

        return self.setting("clear_alarm", carry_out)

    # Questions

    async def status(self) -> TlrStatus:
        """What the drive reports."""
        await self.set_up()
        word, alarm, inputs, outputs, position, rpm = await self.link.read_block(r.TELEMETRY, Urgency.POLL)
        return TlrStatus(word, alarm_of(alarm), inputs, outputs, self._to_units(position), float(self._sign * rpm))

    async def version(self) -> Version:
        """What the drive runs. The two columns are swapped in 3.5.1; the names are taken."""
        return Version(await self.link.read(r.SOFTWARE_VERSION), await self.link.read(r.HARDWARE_VERSION))
