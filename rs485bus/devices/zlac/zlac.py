"""ZLAC8015D: two hub motors on one address. Source: ZLAC8015D RS485 V1.06."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar

from rs485bus.arguments import choice, flag, instance, pair, positive, rate
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.watchdog.guard import WatchdogGuard
from rs485bus.devices.zlac import plans
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.ability import ZlacOptions
from rs485bus.devices.zlac.counters import Counters
from rs485bus.devices.zlac.drive import ZlacDrive
from rs485bus.devices.zlac.frames import MAX_ADDRESS, read
from rs485bus.devices.zlac.memory import read_words
from rs485bus.devices.zlac.parameters import check_parameter, set_brakes, write_parameter
from rs485bus.devices.zlac.setup import ZlacSetup, set_up
from rs485bus.devices.zlac.status import BLOCKS, ZlacStatus, status_from
from rs485bus.devices.zlac.streams import Begin, PairStream
from rs485bus.devices.zlac.telemetry import Snapshot, snapshot
from rs485bus.devices.zlac.together import Both
from rs485bus.devices.zlac.values import Brake, Side
from rs485bus.devices.zlac.wheel import Turns, ZlacWheel
from rs485bus.devices.zlac.wheel import pair as pair_wheels
from rs485bus.motion.move import Move
from rs485bus.motion.plan import Plan, Stand
from rs485bus.motion.state import Fact
from rs485bus.motion.supervisor import Supervisor
from rs485bus.motion.terms import Speeds
from rs485bus.wire.frames import payload, unit_address
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")


class Zlac8015d:
    """A ZLAC8015D drive and its two wheels, `left` and `right`.

    Each wheel is an axis of its own; the drive's verbs command both at once. Commands queue for each wheel, and one of
    the pair begins when both wheels have come to it.

    Args:
        bus: the bus it is on.
        address: 1..127.
        units_per_turn: positions are in units of this many to a turn of a wheel; 1 for turns.
        reverse: for the left and the right wheel, whether positive is the other way round. On most vehicles one wheel
            is mounted mirrored.
        limits: lowest and highest position that a wheel may go to, in units.
        rpm: the speed of moves that name none.
        acceleration: the acceleration of moves that name none, in rpm/s.
        max_rpm: the highest speed, in rpm. What the drive is set to (0x2008) may lower it; 3000 is the end.
        tolerance: counts by which a position may differ from its target.
        encoder_lines: what the motors have. Another value in the drive is reported; None to trust the drive.
        speed_resolution: steps to one rpm, 1..10, that the drive is set to (0x2022); None to leave it as it is.
        status_word_left: which half of the status word is the left wheel's. The manual says the low one, users the
            high one. Nothing that concerns safety depends on it.
        ramp_rpm: the change of speed, in rpm, that takes a ramp time. The manual does not say; None for any change.
        smooth_stop: stop positions and torques by a change to velocity mode with target 0, with the ramp. The manual
            does not say whether wheels that turn obey that; without, they are stopped by the emergency stop's ramp.
        scaled_position_speed: whether 0x2022 scales the speed of positions, too. The manual does not say; where it
            does and this is False, they are too slow.
        zero_in_position_mode: set zero in position mode, as the text of 0x2005 may mean, instead of velocity mode.

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
        units_per_turn: float = 1.0,
        reverse: tuple[bool, bool] = (False, False),
        limits: tuple[float, float] | None = None,
        rpm: float = 60.0,
        acceleration: float = 120.0,
        max_rpm: float = 1000.0,
        tolerance: int = 16,
        encoder_lines: int | None = None,
        speed_resolution: int | None = None,
        status_word_left: Literal["low", "high"] = "low",
        ramp_rpm: float | None = None,
        smooth_stop: bool = False,
        scaled_position_speed: bool = False,
        zero_in_position_mode: bool = False,
    ) -> None:
        self.bus = bus
        self.address = unit_address(address, highest=MAX_ADDRESS)
        reverses = pair("reverse", reverse, "a pair of True or False: (left, right)")
        options = ZlacOptions(
            max_rpm=max_rpm,
            encoder_lines=encoder_lines,
            speed_resolution=speed_resolution,
            status_word_left=status_word_left,
            ramp_rpm=ramp_rpm,
            smooth_stop=flag("smooth_stop", smooth_stop),
            scaled_position_speed=scaled_position_speed,
            zero_in_position_mode=zero_in_position_mode,
        )
        drive = self._drive = ZlacDrive(self.address, options)
        self.attached: DeviceAdapter = drive
        self.name = drive.name
        supervisor = self._supervisor = Supervisor(bus, drive)
        turns = Turns()
        self.left, self.right = (
            ZlacWheel(
                bus,
                drive,
                side,
                supervisor,
                turns,
                units_per_turn=units_per_turn,
                reverse=reverses[side.index],
                limits=limits,
                rpm=rpm,
                acceleration=acceleration,
                tolerance=tolerance,
            )
            for side in Side
        )
        self._wheels = (self.left, self.right)
        for wheel, other in ((self.left, self.right), (self.right, self.left)):
            wheel.stop_with(other)
            wheel.ask_drive(self.status, self.clear_faults)
        drive.now = bus.now
        drive.on_interrupted = self._was_interrupted
        drive.on_recounted = self._recount
        signs = tuple(-1 if wheel.reverse else 1 for wheel in self._wheels)
        self._counters = Counters(bus, drive, (signs[0], signs[1]), self.left._knowledge)
        """The counters of both wheels, for odometry."""
        self._runs: list[Both[float]] = []
        """Those that another one may replace."""
        bus.attach(self)

    def __repr__(self) -> str:
        return f"<{self.name}>"

    # Verbs

    def enable(self) -> Both[None]:
        """Hold both wheels, so that they take commands. Nothing that they were told before goes on.

        After an emergency stop, a trip, or a stop that was not confirmed, its first frame is a stop.
        """
        return Both(self.left.enable(), self.right.enable())

    def release(self) -> Both[None]:
        """Let go of both wheels, once what is queued is done and they stand. They can be turned then, and roll away."""
        return self._once("release", self._let_go)

    def clear_faults(self) -> Both[None]:
        """Clear the errors of both wheels. They are released then: `enable()`.

        Raises, when awaited:
            DriveFault: what caused them is still there.
        """
        for wheel in self._wheels:
            wheel.forgive()
        return self._once("clear_faults", lambda: plans.clear_faults(self._drive))

    def clear_fault(self) -> Both[None]:
        """The same as `clear_faults`, as all families call it."""
        return self.clear_faults()

    def move_to(
        self, left: float, right: float, *, rpm: float | None = None, acceleration: float | None = None
    ) -> Both[float]:
        """Send both wheels to positions, started by one frame. Arguments and errors as for an axis."""
        return self._pair(lambda wheel, to: wheel.move_to(to, rpm=rpm, acceleration=acceleration), left, right)

    def move_by(
        self, left: float, right: float, *, rpm: float | None = None, acceleration: float | None = None
    ) -> Both[float]:
        """Send both wheels a way, started by one frame. Arguments and errors as for an axis."""
        return self._pair(lambda wheel, by: wheel.move_by(by, rpm=rpm, acceleration=acceleration), left, right)

    def run(
        self,
        left: float,
        right: float,
        *,
        acceleration: float | None = None,
        duration: float | None = None,
        replace: bool = False,
    ) -> Both[float]:
        """Turn both wheels at speeds, in rpm, told by one frame. Arguments and errors as for an axis.

        Args:
            left: the left wheel's speed.
            right: the right wheel's speed.
            acceleration: rpm/s.
            duration: seconds; None to go on until told otherwise.
            replace: do not wait until the pair has the speeds told before. Such a run ends as done; one that has not
                begun is cancelled.
        """
        replace = flag("replace", replace)
        both = self._pair(lambda wheel, rpm: wheel.run(rpm, acceleration=acceleration, duration=duration), left, right)
        if replace:
            for earlier in self._runs:
                self._replace(earlier)
        self._runs = [earlier for earlier in self._runs if not earlier.done()]
        if duration is None:
            self._runs.append(both)
        return both

    def torque(self, left: int, right: int, *, slope: int | None = None) -> Both[float]:
        """Push with both wheels, in mA, told by one frame. Arguments and errors as for a wheel."""
        return self._pair(lambda wheel, torque: wheel.torque(torque, slope=slope), left, right)

    def stream(self, *, timeout: float = 0.25, acceleration: float | None = None) -> PairStream:
        """Turn both wheels at speeds that are told as they come, in rpm.

        `async with base.stream() as setpoint: setpoint(60, 40)`.

        The newest set-point counts and goes out, for both wheels in one frame, as soon as the wire allows. One that is
        too old stops both by their ramp; that is no error, and the next one goes on. Leaving the block stops them, too.

        Args:
            timeout: seconds after which a set-point is too old.
            acceleration: of a wheel, in rpm/s, up and down; None for the wheels' own, infinity for a jump.

        Raises:
            LimitExceeded, TypeError: one of them is out of its range, or no number.
        """
        return self._stream_as(timeout, self.left.acceleration if acceleration is None else acceleration)

    def _stream_as(
        self, timeout: float, acceleration: float, needs: Callable[[Speeds], float] | None = None
    ) -> PairStream:
        """The same where a change of both speeds takes as long as `needs` says, in seconds. For a vehicle."""
        told = positive("timeout (s)", timeout), rate("acceleration (rpm/s)", acceleration)
        return PairStream(self._drive, self._wheels, self._queue_stream, self.stop, *told, needs)

    def _queue_stream(self, begin: Begin) -> tuple[Move, Move]:
        """Queue a stream of both wheels."""
        first = self.left._new_stream(begin)
        try:
            second = self.right._new_stream(begin)
        except Exception:
            first.cancel()
            raise
        pair_wheels(self._wheels, (first, second))
        return first, second

    def set_zero(self) -> Both[None]:
        """Make the positions at which both wheels then stand their zeros."""
        return Both(self.left.set_zero(), self.right.set_zero())

    def stop(self) -> Handle[None]:
        """Stop both wheels, with the ramp where they run at speeds; see them stand, and drop what is queued."""
        return self._stop(emergency=False)

    def emergency_stop(self) -> Handle[None]:
        """Stop both wheels as fast as the drive can, see them stand, and drop what is queued. Then `enable()`."""
        return self._stop(emergency=True)

    def set_brakes(self, left: Brake, right: Brake) -> Both[None]:
        """Open or close the external brakes, once both wheels stand (3.6). The drive saves it in its EEPROM: a brake
        that works with every stop is better wired to an output (0x201C, 0x201D)."""
        for side, brake in ((Side.LEFT, left), (Side.RIGHT, right)):
            r.BRAKE.of(side).raw(brake)
        return self._once("set_brakes", lambda: set_brakes(self._drive, left, right))

    def set_parameter(self, register: Register[T], value: T, *, save: bool = False) -> Both[None]:
        """Set one of `registers`, once both wheels stand.

        Args:
            register: what to set.
            value: in the register's unit.
            save: whether the drive keeps it when it is switched off. It then goes to the EEPROM, which takes some
                hundred thousand writes in all.

        Raises:
            LimitExceeded: the value is out of its range.
            NotSupported: the facade sets it itself, or it changes who answers: then `bus.unit()` writes it.
        """
        check_parameter(self._drive, register, value, save)
        return self._once(f"set {register.name}", lambda: write_parameter(self._drive, register, value, save))

    def watchdog(self, timeout: float, *, lease: float | None = None) -> WatchdogGuard:
        """Guard both wheels by the drive's own watchdog while a block runs. As `Bus.watchdog`."""
        return self.bus.watchdog(self, timeout=timeout, lease=lease)

    # Questions

    async def set_up(self) -> ZlacSetup:
        """Set the drive up now instead of before the first command, and say what was found."""
        return await self.left.carry(lambda: set_up(self._drive))

    async def snapshot(self) -> Snapshot:
        """Counts, speeds, torques, errors and status word of both wheels at one moment, in the drive's own terms."""
        answer = await self._supervisor.questions.ask(Fact.FAULT)
        return snapshot(read_words(answer.request, answer.reply), answer.at)

    async def status(self) -> ZlacStatus:
        """What the drive reports. The wheels are of one moment."""
        await self.set_up()
        return status_from(
            [await self._read_block(block, Urgency.POLL) for block in BLOCKS],
            self._drive.options.status_word_left,
            [wheel.counts_per_turn / wheel.units_per_turn for wheel in self._wheels],
            [-1 if wheel.reverse else 1 for wheel in self._wheels],
        )

    async def parameter(self, register: Register[T]) -> T:
        """What one of `registers` holds."""
        instance("register", register, Register, "registers.RATED_CURRENT.of(Side.LEFT)")
        return register.decode(payload(await self.bus.ask(read(self.address, register))))

    async def parameters(self, side: Side) -> dict[str, float]:
        """All parameters of one motor, by name, in their units."""
        parameters = {}
        for block in r.PARAMETER_BLOCKS[choice("side", side, Side)]:
            values = await self._read_block(block)
            parameters.update({field.name: value for field, value in zip(block.fields, values, strict=True)})
        return parameters

    @property
    def speed_resolution(self) -> int:
        """Steps to one rpm (0x2022), as far as is known: what was asked for, or 1, before it was set up."""
        return self._drive.abilities[0].resolution

    async def drain(self) -> None:
        """Wait until nothing is queued or on its way to a target, of either wheel."""
        await self.left.drain()

    # Inside

    def _pair(self, command: Callable[[ZlacWheel, T], Move], left: T, right: T) -> Both[float]:
        """Queue a command for both wheels, which they carry out together."""
        first = command(self.left, left)
        try:
            second = command(self.right, right)
        except Exception:
            first.cancel()
            raise
        pair_wheels(self._wheels, (first, second))
        return Both[float](first, second)

    def _replace(self, run: Both[float]) -> None:
        parts = ((self.left, run.left), (self.right, run.right))
        if any(wheel.carries_out(part) for wheel, part in parts):
            for wheel, part in parts:
                wheel.overtake(part)
        else:
            run.cancel()

    def _once(self, what: str, plan: Callable[[], Plan[None]]) -> Both[None]:
        """Queue something for both wheels that is done once, when both have come to it."""
        self.left.check_ready()
        self.right.check_ready()
        parts = self.left.order_once(what, plan), self.right.order_once(what, plan)
        pair_wheels(self._wheels, parts)
        return Both(*parts)

    def _let_go(self) -> Plan[None]:
        yield Stand(whole=True)
        yield from plans.release(self._drive, 0, 1)

    def _stop(self, emergency: bool) -> Handle[None]:
        handle: Handle[None] = Handle(f"stop of {self.name}", self.bus.unseen)
        for wheel in self._wheels:
            wheel.stopped_as_pair(handle)
        # Whoever asks for it may know of a motion that is not known here.
        self._drive.motion.moves()

        def told(halted: Halted) -> None:
            if halted.standing:
                handle.finish(None)
            else:
                left, _ = (wheel.unconfirmed() for wheel in self._wheels)
                handle.fail(left)

        self.bus.halt(self._drive, self._drive.motion, emergency=emergency, told=told)
        return handle

    def abandon(self, why: str) -> None:
        """End everything that is queued. For the bus."""
        for wheel in self._wheels:
            wheel.abandon(why)

    async def _read_block(self, block: Block, urgency: Urgency = Urgency.COMMAND) -> tuple[Any, ...]:
        return block.decode(payload(await self.bus.ask(read(self.address, block), urgency=urgency)))

    def _was_interrupted(self, unheard: float, reason: str) -> None:
        for wheel in self._wheels:
            wheel.was_interrupted(unheard, reason)

    def _recount(self) -> None:
        for wheel in self._wheels:
            wheel.recount()
