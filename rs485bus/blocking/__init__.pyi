"""The blocking face, as type checkers and editors read it.

Written by `python -m tests.blocking.stub` from the asynchronous classes; a test holds it against them.
"""

from collections.abc import Iterator as _Iterator
from types import TracebackType as _TracebackType
from typing import Generic, Literal, Self, TypeVar, overload
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from rs485bus.bus.config import BusConfig
from rs485bus.bus.functions import RequestOptions
from rs485bus.bus.port_urls import Backend
from rs485bus.bus.record import BusStats, Record
from rs485bus.bus.recording import Recording
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.watchdog.guarding import EmergencyReport
from rs485bus.bus.watchdog.report import WatchReport
from rs485bus.devices.mks.homing import Homing
from rs485bus.devices.mks.settings import Gains, MksProfile, PositionProtection, PulseDivider
from rs485bus.devices.mks.status import Encoder, Homings, MksStatus
from rs485bus.devices.mks.values import EnableLevel, HoldingCurrent, Inputs as Inputs2, Model, MotionDirection, OutputMask, ParameterDirection, Status, WorkMode
from rs485bus.devices.tlr.homing import Homing as Homing2
from rs485bus.devices.tlr.stepper import TlrStatus, Version
from rs485bus.devices.tlr.tables import Path, SpeedPath
from rs485bus.devices.tlr.values import BaudRate, DiFunction, DoFunction, LimitStop, OperatingMode, PathMode, PathTrigger, SerialFormat
from rs485bus.devices.zlac.odometry import OdometrySample, Pose
from rs485bus.devices.zlac.setup import ZlacSetup
from rs485bus.devices.zlac.status import WheelStatus, ZlacStatus
from rs485bus.devices.zlac.telemetry import Snapshot
from rs485bus.devices.zlac.values import Brake, Side
from rs485bus.motion.events import Event
from rs485bus.motion.move import MoveState
from rs485bus.motion.sample import AxisSample
from rs485bus.motion.streaming import Streamer
from rs485bus.plant import PlantFile
from rs485bus.transport.interface import Transport
from rs485bus.wire.diagnostics import DeviceInformation, EventCounter, EventLog
from rs485bus.wire.private import Reply
from rs485bus.wire.registers import Register
from rs485bus.wire.timing import LineSettings, Parity
from typing import Any, Generic, Never, Unpack

A = TypeVar("A")
B = TypeVar("B")
C = TypeVar("C")
T = TypeVar("T")
_V = TypeVar("_V", covariant=True)

class Stream(_Iterator[_V]):
    """What comes one after the other. `close()` ends it; so does letting go of it."""
    def __next__(self) -> _V: ...
    def close(self) -> None: ...

def open_bus(port: str | PathLike[str] | Transport, *, baudrate: int | None = None, parity: Parity = 'N', stopbits: Literal[1, 2] = 1, backend: Backend | None = None, native: bool = False, config: BusConfig = ...) -> Bus:
    """Open the bus on a port, now.

    `with open_bus(...) as bus:` closes it at the end: a block that ends well waits for queued moves first, one left by
    an exception stops every axis that may move. Without a block `bus.close()` does, and the end of the program.

    Arguments and errors are those of `rs485bus.open_bus`.
    """
    ...
class Axis:
    """One motor.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        number: which one of the drive's axes it is.
        name: names it in messages.
        supervisor: what looks at the drive.
        units_per_turn: positions are in units of this many to a turn of the motor; 1 for turns.
        reverse: whether positive is the other way round.
        limits: lowest and highest position that may be gone to, in units; None for no limit.
        rpm: the speed of moves that name none.
        acceleration: the acceleration of moves that name none, in rpm/s.
        tolerance: counts of the drive by which an axis that has arrived may differ from its target; None for 1°.

    Raises:
        LimitExceeded, ValueError: an argument is out of its range.
        TypeError: one is of a wrong type.
    """
    counts_per_turn: float
    bus: Bus
    name: str
    rpm: float
    acceleration: float
    def disable(self) -> Handle[None]:
        """Let go of the shaft, once what is queued before it is done and the motor stands. It can then be turned."""
        ...
    def drain(self) -> None:
        """Wait until nothing is queued or on its way to a target."""
        ...
    def emergency_stop(self) -> Handle[None]:
        """Stop as fast as the drive can, see that it stands, and drop what is queued."""
        ...
    def enable(self) -> Handle[None]:
        """Energise the motor, so that it holds its position and takes moves.

        After an emergency stop, a trip, or a stop that was not confirmed, its first frame is a stop.
        """
        ...
    def events(self) -> Stream[Event]:
        """What happens to the axis from now on: faults, limits, stalls, restarts, trips, stops, lost and back.

        It ends when the bus is closed.

        Raises:
            BusClosed: the bus is closed already.
        """
        ...
    def idle(self) -> bool:
        """Whether nothing is queued and the motor stands."""
        ...
    @property
    def limits(self) -> tuple[float, float] | None:
        """Lowest and highest position that may be gone to, in units; None for no limit."""
        ...
    def move_by(self, distance: float, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go a distance: from the target of the last move if that was reached, else from where the axis stands.

        It is sent as an absolute target, so that it happens once, however often it must be said. Arguments and errors
        as for `move_to`.
        """
        ...
    def move_to(self, position: float, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go to a position.

        Args:
            position: in the axis' units.
            rpm: the speed, above 0.
            acceleration: in rpm/s; infinity for a jump.

        Raises:
            LimitExceeded: one of them is out of its range, or the drive cannot be told it within 5 %; nothing is
                queued.
            TypeError: one of them is no number; nothing is queued.
        """
        ...
    def position(self) -> float:
        """Where the axis is, in its units."""
        ...
    @property
    def reverse(self) -> bool:
        """Whether positive is the other way round."""
        ...
    def run(self, rpm: float, *, acceleration: float | None = None, duration: float | None = None, replace: bool = False) -> Move:
        """Turn at a speed. Done once that is reached; with a `duration`, once the motor stands again after it.

        Args:
            rpm: the speed; its sign is the direction, and 0 slows down to a stand.
            acceleration: in rpm/s; infinity for a jump.
            duration: seconds; None to go on until told otherwise.
            replace: do not wait until the speeds are reached that were told before. Such a run ends as done; one that
                has not begun is cancelled. For more than a few there is `stream`.

        Raises:
            LimitExceeded, TypeError: as `move_to`.
        """
        ...
    @property
    def sample(self) -> AxisSample:
        """What is known of the axis now, without a frame."""
        ...
    def samples(self, every: float = 0.05) -> Stream[AxisSample]:
        """A sample every so many seconds. Only what nobody has asked since the one before is asked for.

        Where the drive does not answer, samples grow old (`age`).
        """
        ...
    def set_zero(self) -> Handle[None]:
        """Make the position at which the axis then stands its zero."""
        ...
    def stop(self) -> Handle[None]:
        """Stop with the ramp of the running move, see that it stands, and drop what is queued.

        It happens at once, whether the handle is awaited or not, and is repeated until it is confirmed by reading. A
        repetition is the same stop. An emergency stop follows where the drive acknowledged it and does not stand after
        one and a half times its stopping time, or where it acknowledged neither of two.

        Raises:
            StopUnconfirmed: when it is awaited: the axis could not be seen standing after three stops, or while the
                port was away. It is stopped further on.
        """
        ...
    def stream(self, *, timeout: float = 0.25, acceleration: float | None = None) -> SetpointStream:
        """Turn at speeds that are told as they come: `async with axis.stream() as setpoint: setpoint(90.0)`.

        The newest set-point counts and goes out as soon as the wire allows; nothing queues. One that is too old stops
        the motor by its ramp; that is no error, and the next one goes on. Leaving the block stops, too. It joins the
        queue: what was asked for before is done first. `limits` hold.

        Args:
            timeout: seconds after which a set-point is too old.
            acceleration: the ramp up and down, in rpm/s; None for the axis' own, infinity for a jump.

        Raises:
            LimitExceeded, TypeError: one of them is out of its range, or no number.
        """
        ...
    @property
    def tolerance(self) -> int:
        """Counts of the drive by which it may differ from its target when it has arrived."""
        ...
    @property
    def units_per_turn(self) -> float:
        """Positions are in units of this many to a turn of the motor."""
        ...
    def velocity(self) -> float:
        """How fast the motor turns, in rpm."""
        ...
    def watchdog(self, timeout: float, *, lease: float | None = None) -> WatchdogGuard:
        """Guard the axis by its drive's own watchdog while a block runs. As `Bus.watchdog`."""
        ...

class AxisGroup:
    """Axes that move together, each by a name of its own.

    Args:
        axes: the axes. They may be of any families, and on several buses of one event loop.

    Raises:
        ValueError: there is none, one has two names, or a name is taken.
        TypeError: something is no axis.
    """
    axes: Mapping[str, Axis]
    def __init__(self, *unnamed: Never, **axes: Axis) -> None:
        ...
    def disable(self) -> HandleOfSeveral[None]:
        """Let go of all shafts, as `Axis.disable`."""
        ...
    def emergency_stop(self) -> HandleOfSeveral[None]:
        """Stop all axes as fast as their drives can; see them stand, and drop what is queued."""
        ...
    def enable(self) -> HandleOfSeveral[None]:
        """Energise all motors, as `Axis.enable`."""
        ...
    def home(self) -> HandleOfSeveral[float]:
        """Find the origins of all axes, at once, each as its drive is set up for. All are waited for.

        Raises:
            NotSupported: one has no origin to find, as wheels have none: `set_zero()` it. Nothing is queued.
        """
        ...
    def move_by(self, *, duration: float | None = None, rpm: float | None = None, **distances: float) -> GroupMove:
        """Send axes a distance each. Arguments and errors as for `move_to`."""
        ...
    def move_to(self, *, duration: float | None = None, rpm: float | None = None, **positions: float) -> GroupMove:
        """Send axes to positions: they start together and arrive together. Those that are not named stay out of it.

        Each gets the speed and, where steps of that are too coarse, the ramp with which it takes as long as all; ramps
        are never quicker than the axis' own `acceleration`. It is one command in the queue of each, and begins when all
        have come to it.

        Args:
            duration: seconds; None for as long as the slowest needs at its own `rpm`, or at the one given. An axis with
                so short a way that it cannot be so slow then arrives earlier.
            rpm: the highest speed of any of them, above 0.
            positions: where to go, by name, in the units of each axis.

        Raises:
            LimitExceeded: a position, a speed or the duration is out of what an axis can do; nothing is queued. What
                duration an axis can do depends on where it starts: where that is not known yet, it is raised when the
                move is awaited, and nothing has moved.
            ValueError: a name is none of the group, or none is given.
            TypeError: something is no number.
        """
        ...
    def positions(self) -> dict[str, float]:
        """Where each axis is, in its units."""
        ...
    def stop(self) -> HandleOfSeveral[None]:
        """Stop all axes, with their ramps; see them stand, and drop what is queued. It happens at once."""
        ...
    def stream(self, *, timeout: float = 0.25, acceleration: float | None = None) -> GroupStream:
        """Turn all axes at speeds that are told as they come: `async with group.stream() as setpoint:
        setpoint(x=90.0, y=-30.0)`. Where one axis fails, all are stopped.

        Args:
            timeout: seconds after which a set-point is too old.
            acceleration: the ramps of all, in rpm/s; None for each axis' own.

        Raises:
            NotSupported: one of them cannot be told speeds in a stream.
            LimitExceeded, TypeError: an argument is out of its range, or no number.
        """
        ...

class Both(Generic[T]):
    """A command of both wheels, on its way. Awaiting it gives the result of the left and of the right one.

    Args:
        left: the left wheel's part.
        right: the right wheel's part.
    """
    left: Handle[T]
    right: Handle[T]
    def add_done_callback(self, callback: Callable[[Both[T]], object]) -> None:
        """Have `callback` called with this once both have ended, as `Handle.add_done_callback`."""
        ...
    def cancel(self) -> None:
        """End it: one that waits leaves the queues, one under way stops both wheels. It raises `MoveCancelled`."""
        ...
    def done(self) -> bool:
        """Whether both have ended, well or not."""
        ...
    error: Exception | None
    def wait(self, timeout: float | None = None) -> tuple[T, T]:
        """Wait for its end, and return its result.

        A terminal or a notebook shows how far it is. Ctrl-C stops the motors first, and is raised when they stand.

        Args:
            timeout: seconds; None for as long as it takes.

        Raises:
            LimitExceeded, TypeError: the timeout is no number. It goes on.
            RequestFailed, MotionError: why it failed.
            TimeoutError: it has not ended yet. It goes on: `cancel()` or `stop()` ends it.
        """
        ...

class Broadcast:
    """Writes to every device on the pair. Nobody answers, so nobody knows who heard it.

    Args:
        bus: the bus.
    """
    def mask_write_register(self, address: int, and_mask: int = 65535, or_mask: int = 0, *, family: str | None = None) -> None:
        """Set and clear bits of the register at `address` of every device, function 22, as `Unit` does.

        As `write_register` otherwise.
        """
        ...
    def write_coil(self, address: int, value: bool, *, family: str | None = None) -> None:
        """Set or clear the coil at `address` of every device, function 05. As `write_register` otherwise."""
        ...
    def write_coils(self, address: int, values: Sequence[bool], *, family: str | None = None) -> None:
        """Set or clear 1..1968 coils from `address` on, function 15. As `write_register` otherwise."""
        ...
    def write_register(self, address: int, value: int, *, family: str | None = None) -> None:
        """Write `value` (0..65535) to the register at `address` of every device, function 06.

        Returns when the turnaround after it is over. `family` names the family it is meant for ("MKS"), where devices
        of several are attached.

        Raises:
            BroadcastConflict: a device of another family would act on it.
        """
        ...
    def write_registers(self, address: int, values: Sequence[int], *, family: str | None = None) -> None:
        """Write 1..123 `values` from `address` on, function 16. As `write_register` otherwise."""
        ...

class Bus:
    """One RS-485 pair, for programs without `async`. Made by `open_bus`.

    Any thread may call it. Ctrl-C stops its axes before it is raised in the main thread.
    """
    config: BusConfig
    broadcast: Broadcast
    def mks(self, address: int, *, model: Model = ..., mode: WorkMode = ..., microsteps: int = 16, units_per_turn: float = 1.0, reverse: bool = False, positive: MotionDirection = ..., limits: tuple[float, float] | None = None, rpm: float = 300.0, acceleration: float = 1000.0, tolerance: int | None = None) -> MksServo:
        """The MKS SERVO drive at an address, 1..247. Settings and errors are those of `MksServo`.

        Asked for again, with the same settings or without, it is the same one: a notebook's cell can be run twice.
        """
        ...
    def tlr(self, address: int, *, pulses_per_turn: int | None = None, units_per_turn: float = 1.0, reverse: bool = False, limits: tuple[float, float] | None = None, rpm: float = 300.0, acceleration: float = 2000.0, deceleration: float | None = None, start_rpm: int = 0, tolerance: int | None = None, clear_trigger: bool = True, block_writes: bool = True, keeps_target: bool = True, enabled_bit: bool = False, live_jog: bool = False, ramp_rpm: float | None = None) -> TlrStepper:
        """The TL-R stepper at a station, 1..247. Settings and errors are those of `TlrStepper`. As `mks` otherwise."""
        ...
    def zlac(self, address: int, *, units_per_turn: float = 1.0, reverse: tuple[bool, bool] = ..., limits: tuple[float, float] | None = None, rpm: float = 60.0, acceleration: float = 120.0, max_rpm: float = 1000.0, tolerance: int = 16, encoder_lines: int | None = None, speed_resolution: int | None = None, status_word_left: Literal['low', 'high'] = 'low', ramp_rpm: float | None = None, smooth_stop: bool = False, scaled_position_speed: bool = False, zero_in_position_mode: bool = False) -> Zlac8015d:
        """The ZLAC8015D at an address, 1..127, with its two wheels `left` and `right`. Settings and errors are those of
        `Zlac8015d`. As `mks` otherwise.
        """
        ...
    def group(self, *unnamed: Never, **axes: Axis) -> AxisGroup:
        """Axes that move together, each by a name of its own. Errors are those of `AxisGroup`."""
        ...
    def vehicle(self, zlac: Zlac8015d, wheel_radius: float, track: float, **settings: Any) -> DifferentialDrive:
        """A vehicle on the two wheels of a ZLAC8015D. Arguments and errors are those of `DifferentialDrive`."""
        ...
    def timeline(self) -> Any:
        """A picture of the latest 256 transactions, as a matplotlib figure: who was asked when, latency, load, axes.

        Raises:
            ValueError: nothing happened yet.
            ModuleNotFoundError: matplotlib is missing: pip install "rs485bus[plot]".
        """
        ...
    def close(self, *, leave_running: bool | None = None) -> None:
        """Stop every axis that may move, see it stand, release the watchdogs, close the port. Ctrl-C waits for it.

        Args:
            leave_running: leave motors turning; None for what the configuration says.
        """
        ...
    def __enter__(self) -> Self: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: _TracebackType | None) -> Literal[False] | None: ...
    def clear_emergency_stop(self) -> None:
        """Allow motion again, once the report of the emergency stop is there. Each axis then needs `enable()`.

        Raises:
            BusError: the report is not there yet.
        """
        ...
    @property
    def closed(self) -> bool:
        """Whether it was closed, for good."""
        ...
    @property
    def closing(self) -> bool:
        """Whether it is being closed, or is closed: nothing is set in motion any more."""
        ...
    @property
    def connected(self) -> bool:
        """Whether the port is there."""
        ...
    def drain(self) -> None:
        """Wait until no axis has anything queued or moving."""
        ...
    def emergency_stop(self) -> Handle[EmergencyReport]:
        """Stop every device as fast as it can, and let nothing move until `clear_emergency_stop()`.

        It happens at once, from any task or signal handler, whether the handle is awaited or not. The report says
        which devices were read to stand. Raises `BusClosed` where the bus is closed.
        """
        ...
    def failures(self) -> list[Exception]:
        """The failures that nobody has seen, each once."""
        ...
    @property
    def flight(self) -> list[Record]:
        """The flight recorder: the latest 256 transactions, the oldest first."""
        ...
    @property
    def latched(self) -> bool:
        """Whether an emergency stop holds."""
        ...
    @property
    def line(self) -> LineSettings:
        """How characters travel on the pair."""
        ...
    def on_lost(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Have `callback` called whenever the port is lost. Returns a function that ends that."""
        ...
    @property
    def port(self) -> str:
        """What it was opened on, as people call it."""
        ...
    def record_to(self, path: str | PathLike[str], *, max_bytes: int = 20000000, keep: int = 4) -> Recording:
        """Write what happens on the bus from now on to a capture file, until it is closed, or the recording is.

        `rs485bus explain`, `plot` and `pcap` read it. The bus does not wait for the disk.

        Args:
            path: the file. A capture that is there already is kept, as `path.1`.
            max_bytes: how long one file may become, 10,000 at the least; then it becomes `path.1`.
            keep: how many older files are kept, 0..1000.

        Raises:
            ValueError: there is a file that is no capture, or an argument is out of its range.
            OSError: the file cannot be written.
        """
        ...
    @property
    def stats(self) -> BusStats:
        """What happened on the bus since it was opened. Counts go on; copy what you want to keep."""
        ...
    @property
    def stopped(self) -> list[Halted]:
        """How each device that might have moved ended up when the bus was closed."""
        ...
    def subscribe(self, observer: Callable[[Record], None]) -> Callable[[], None]:
        """Have `observer` called with the record of each transaction. Returns a function that ends that.

        It is called on the event loop, between two frames: it must be quick.
        """
        ...
    def unit(self, address: int, *, reply_timeout: float | None = None, pause: float | None = None, probe: Register[Any] | Literal[False] | None = None, allow_reserved_address: bool = False) -> Unit:
        """Plain Modbus to the device at `address` (1..247).

        What is given holds for every request to it from now on, whoever sends it; what is not given stays as it was.

        Args:
            address: its address.
            reply_timeout: seconds it may take to begin an answer, 0.001..10; at first what the bus is set to.
            pause: seconds of quiet on the pair that it wants before a request, 0..1; at first what all get.
            probe: a register that may be read at any time to see whether it answers; False where nothing may be read
                unasked, because reading clears something, say.
            allow_reserved_address: 248..255 may be its address, too. The specification reserves them; some devices can
                be set to one.

        Raises:
            ValueError, TypeError: an argument out of its range, or of a wrong type.
            WatchdogInfeasible: a guarded device could not be waited for as long as that while a watchdog is armed.
        """
        ...
    def watchdog(self, *axes: Axis | Zlac8015d, timeout: float, lease: float | None = None) -> WatchdogGuard:
        """Arm the watchdogs of some axes, and feed them while a block runs.

        Args:
            axes: what to guard; all that share a device are guarded with it.
            timeout: seconds without a frame after which the device stops its motor by itself.
            lease: seconds within which `renew()` must be called each time, lest the axes are stopped.

        Returns:
            An async context manager. Entering it raises `WatchdogInfeasible` if the devices cannot be fed in time,
            and `WatchdogInUse` if another block guards one of them.

        Raises:
            ValueError: no axis was named.
            NotSupported: a drive has no watchdog.
            LimitExceeded: its register cannot hold the time.
        """
        ...

class Handle(Generic[T]):
    """A command on its way. It happens whether it is awaited or not.

    Awaiting gives its result or raises why it failed; any number may await it, at any time, in any event loop.
    Cancelling an await leaves the command alone.

    Args:
        what: names it in messages.
        unseen: told of a failure, which those who await it have not seen yet.
    """
    what: str
    seen: bool
    def add_done_callback(self, callback: Callable[[Handle[Any]], object]) -> None:
        """Have `callback` called with this handle when it ends, before anybody who awaits it goes on.

        Where it has ended already, `callback` is called at once. An exception that `callback` raises is logged.

        Raises:
            TypeError: it cannot be called.
        """
        ...
    def done(self) -> bool:
        """Whether it has ended, well or not."""
        ...
    error: Exception | None
    def wait(self, timeout: float | None = None) -> T:
        """Wait for its end, and return its result.

        A terminal or a notebook shows how far it is. Ctrl-C stops the motors first, and is raised when they stand.

        Args:
            timeout: seconds; None for as long as it takes.

        Raises:
            LimitExceeded, TypeError: the timeout is no number. It goes on.
            RequestFailed, MotionError: why it failed.
            TimeoutError: it has not ended yet. It goes on: `cancel()` or `stop()` ends it.
        """
        ...

class Cancellable(Handle[T]):
    """A command that can be ended.

    `async with` waits for it at the end of the block, and ends it if the block is left by an exception.
    """
    def cancel(self) -> None:
        """End it."""
        ...
    def __enter__(self) -> Self: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: _TracebackType | None) -> Literal[False] | None: ...

class DataFunctions:
    """What reads and writes a device's data."""
    address: int
    highest: int
    def mask_write_register(self, address: int, and_mask: int = 65535, or_mask: int = 0, **options: Unpack[RequestOptions]) -> None:
        """Set the register at `address` to (its value AND `and_mask`) OR (`or_mask` AND NOT `and_mask`), function 22.

        Doing it twice is doing it once, so `repeat=Repeat.SAFE` harms nobody who does not write the same register.
        """
        ...
    def read_coils(self, address: int, count: int = 1, **options: Unpack[RequestOptions]) -> list[bool]:
        """Read `count` (1..2000) coils from `address` (0..65535) on, function 01."""
        ...
    def read_discrete_inputs(self, address: int, count: int = 1, **options: Unpack[RequestOptions]) -> list[bool]:
        """Read `count` (1..2000) discrete inputs from `address` (0..65535) on, function 02."""
        ...
    def read_fifo_queue(self, address: int, **options: Unpack[RequestOptions]) -> list[int]:
        """Read the queue of up to 31 registers whose pointer is at `address`, function 24. It stays as it is."""
        ...
    def read_file_record(self, records: Sequence[tuple[int, int, int]], **options: Unpack[RequestOptions]) -> list[list[int]]:
        """Read registers of files, function 20: a list for each of `records`.

        Args:
            records: file number (1..65535), first record (0..9999), how many registers; as many as fit a frame.
            options: as for every request.
        """
        ...
    def read_holding_registers(self, address: int, count: int = 1, **options: Unpack[RequestOptions]) -> list[int]:
        """Read `count` (1..125) registers from `address` (0..65535) on, function 03."""
        ...
    def read_input_registers(self, address: int, count: int = 1, **options: Unpack[RequestOptions]) -> list[int]:
        """Read `count` (1..125) input registers from `address` (0..65535) on, function 04."""
        ...
    def readwrite_registers(self, read_address: int, read_count: int, write_address: int, values: Sequence[int], **options: Unpack[RequestOptions]) -> list[int]:
        """Write 1..121 `values` from `write_address` on, then read `read_count` (1..125) registers, function 23."""
        ...
    def write_coil(self, address: int, value: bool, **options: Unpack[RequestOptions]) -> None:
        """Set or clear the coil at `address`, function 05. `repeat` as for `write_register`."""
        ...
    def write_coils(self, address: int, values: Sequence[bool], **options: Unpack[RequestOptions]) -> None:
        """Set or clear 1..1968 coils from `address` on, function 15. `repeat` as for `write_register`."""
        ...
    def write_file_record(self, records: Sequence[tuple[int, int, Sequence[int]]], **options: Unpack[RequestOptions]) -> None:
        """Write registers of files, function 21. `repeat` as for `write_register`.

        Args:
            records: file number (1..65535), first record (0..9999), the values; as many as fit a frame.
            options: as for every request.
        """
        ...
    def write_register(self, address: int, value: int, **options: Unpack[RequestOptions]) -> None:
        """Write `value` (0..65535) to the register at `address`, function 06.

        It is sent once, unless `repeat` says otherwise: SAFE repeats it blindly, VERIFY reads the register back first.
        """
        ...
    def write_registers(self, address: int, values: Sequence[int], **options: Unpack[RequestOptions]) -> None:
        """Write 1..123 `values` to the registers from `address` on, function 16. `repeat` as for `write_register`."""
        ...

class DiagnosticFunctions:
    """What asks a device about itself. Where there are counters, they are numbers of 16 bits."""
    address: int
    highest: int
    def diag_change_ascii_input_delimeter(self, delimiter: int = 10, **options: Unpack[RequestOptions]) -> None:
        """Set the character (0..255) that ends a message in ASCII mode, subfunction 3."""
        ...
    def diag_clear_counters(self, **options: Unpack[RequestOptions]) -> None:
        """Clear the counters and the diagnostic register, subfunction 10."""
        ...
    def diag_clear_overrun_counter(self, **options: Unpack[RequestOptions]) -> None:
        """Clear the counter of overruns and its flag, subfunction 20."""
        ...
    def diag_force_listen_only(self, **options: Unpack[RequestOptions]) -> None:
        """Make the device listen and answer nothing, this included, subfunction 4. It returns once it is sent."""
        ...
    def diag_get_comm_event_counter(self, **options: Unpack[RequestOptions]) -> EventCounter:
        """Read how many messages the device has completed, function 11."""
        ...
    def diag_get_comm_event_log(self, **options: Unpack[RequestOptions]) -> EventLog:
        """Read its counters and its latest 64 events, function 12."""
        ...
    def diag_getclear_modbus_response(self, data: int = 3, **options: Unpack[RequestOptions]) -> bytes:
        """Read (`data` 3) or clear (4) the Modbus Plus statistics of a Modicon controller, subfunction 21."""
        ...
    def diag_query_data(self, msg: bytes, **options: Unpack[RequestOptions]) -> bytes:
        """Have 1..250 bytes sent back, subfunction 0."""
        ...
    def diag_read_bus_char_overrun_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that it has lost because characters came too fast, subfunction 18."""
        ...
    def diag_read_bus_comm_error_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the CRC errors that it has seen, subfunction 12."""
        ...
    def diag_read_bus_exception_error_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the exceptions that it has answered, subfunction 13."""
        ...
    def diag_read_bus_message_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that the device has seen on the pair, subfunction 11."""
        ...
    def diag_read_device_busy_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages for which it was busy, subfunction 17."""
        ...
    def diag_read_device_message_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that were for it, subfunction 14."""
        ...
    def diag_read_device_nak_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that it has answered by a NAK, subfunction 16."""
        ...
    def diag_read_device_no_response_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that it has not answered, subfunction 15."""
        ...
    def diag_read_diagnostic_register(self, **options: Unpack[RequestOptions]) -> int:
        """Read the diagnostic register, subfunction 2."""
        ...
    def diag_read_iop_overrun_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the overruns of the input/output processor of a Modicon 884, subfunction 19."""
        ...
    def diag_restart_communication(self, toggle: bool = False, **options: Unpack[RequestOptions]) -> None:
        """Restart the device's port and clear its counters, subfunction 1; with `toggle` its event log, too.

        It is the only way out of listen-only mode. A device in that mode does it without an answer, which is told as
        `OutcomeUnknown`.
        """
        ...
    def read_device_information(self, read_code: int = ..., object_id: int = 0, **options: Unpack[RequestOptions]) -> DeviceInformation:
        """Read the identification, function 43 type 14, with as many requests as it takes.

        Args:
            read_code: 1 the basic objects, 2 the regular ones, 3 all, 4 the one named.
            object_id: where to begin, 0..255.
            options: as for every request; `timeout` is for all of them.
        """
        ...
    def read_exception_status(self, **options: Unpack[RequestOptions]) -> int:
        """Read the eight exception status outputs, function 07: one bit each."""
        ...
    def report_device_id(self, **options: Unpack[RequestOptions]) -> bytes:
        """Read what the device says it is, function 17.

        Server id, run indicator (0x00 off, 0xFF on) and more, as the device's manual says: the specification leaves
        their lengths open.
        """
        ...

class DifferentialDrive:
    """Drives a vehicle and knows where it is.

    x is ahead and y to the left of where it began, in metres; headings are radians, counter-clockwise. Positive speeds
    of both wheels must take it ahead: `Zlac8015d(reverse=(False, True))` where the right one is mounted mirrored.

    Every answer of the drive counts, whoever asked: no way of the wheels is lost that was seen.

    Args:
        zlac: the drive and its wheels.
        wheel_radius: metres, up to 5.
        track: metres between the wheels where they touch the ground, up to 50.
        acceleration: m/s² of a wheel, infinity for jumps; None for the wheels' own.
        variance: of the way of a wheel, in m² for each metre that it goes: what slip and worn tyres make of it.

    Raises:
        LimitExceeded, TypeError: one of them is out of its range, or of a wrong type.
    """
    zlac: Zlac8015d
    wheel_radius: float
    track: float
    def __init__(self, zlac: Zlac8015d, wheel_radius: float, track: float, *, acceleration: float | None = None, variance: float = 0.0001) -> None:
        ...
    def drive(self, v: float, omega: float) -> Both[float]:
        """Go ahead at `v` m/s and turn at `omega` rad/s, from now on. It replaces the speeds that were told before.

        The handle is done once both wheels have their speed. The drive takes speeds in steps (`speed_resolution`); the
        next ones towards zero are told.

        Raises:
            LimitExceeded: a wheel would have to turn too fast.
            TypeError: a speed is no number.
        """
        ...
    def enable(self) -> Both[None]:
        """Enable both wheels. As `Zlac8015d.enable`."""
        ...
    @property
    def pose(self) -> Pose:
        """Where it was when the drive was last heard."""
        ...
    def poses(self, every: float = 0.05) -> Stream[Pose]:
        """Where it is, every so many seconds. What is not answered is asked again, for a second.

        Raises:
            NoReply, DeviceOffline: the drive has not answered for longer.
        """
        ...
    def reset(self, pose: Pose | None = None) -> None:
        """Say where it is; None for the origin. Counting goes on from the present counts."""
        ...
    @property
    def sample(self) -> OdometrySample | None:
        """Where it was and how fast when the drive was last heard, and how certain that is; None before `update`."""
        ...
    def speeds_of(self, left: float, right: float) -> tuple[float, float]:
        """The speeds ahead (m/s) and about itself (rad/s) for those of the wheels, in rpm."""
        ...
    def stop(self) -> Handle[None]:
        """Stop with the ramp, and see both wheels stand."""
        ...
    def stream(self, *, timeout: float = 0.25, v: float | None = None, omega: float | None = None, acceleration: float | None = None, angular_acceleration: float | None = None) -> VehicleStream:
        """Go as it is told: `async with vehicle.stream() as setpoint: setpoint(0.3, 0.5)`, in m/s and rad/s.

        The newest set-point counts and goes out, for both wheels in one frame, as soon as the wire allows. What is
        faster than allowed, or than a wheel can turn, is made slower so that the curve stays the same. One that is too
        old stops the vehicle by its ramp; that is no error, and the next one goes on. Leaving the block stops it, too.

        Args:
            timeout: seconds after which a set-point is too old.
            v: the highest speed ahead and back, in m/s; None for what the wheels can.
            omega: the highest speed about itself, in rad/s; None for what the wheels can.
            acceleration: m/s² ahead, up and down; None for that of the wheels.
            angular_acceleration: rad/s² about itself; None for what the wheels' acceleration makes of it.

        Raises:
            ValueError, LimitExceeded, TypeError: one of them is out of its range, or no number.
        """
        ...
    def update(self) -> Pose:
        """Read both counters and say where that puts it.

        Between two readings it is taken to go an arc: update often while it turns, ten times a second, say. Where the
        drive was not heard for a while it is asked first whether it has restarted.

        Raises:
            ReferenceLost: the drive has restarted, or a counter jumped further than its wheel can have turned. `reset`
                says where the vehicle is.
        """
        ...
    def wheels_for(self, v: float, omega: float) -> tuple[float, float]:
        """How fast the left and the right wheel turn, in rpm, for speeds ahead (m/s) and about itself (rad/s)."""
        ...

class GroupMove(Cancellable[dict[str, float]]):
    """A move of several axes. Awaiting it gives the position that each has reached, by name, in its units.

    Where one of them fails, faults, stops answering or is stopped, all others are stopped before anybody is told. It
    raises what the one has failed of, with its name; those that were stopped raise `MoveCancelled`.

    `async with` waits for it at the end of the block, and stops all its axes if the block is left by an exception.
    """
    def cancel(self) -> None:
        """End it: what waits leaves the queues, what is under way is stopped. It raises `MoveCancelled`."""
        ...
    eta: float | None
    @property
    def moves(self) -> Mapping[str, Move]:
        """The part of each axis, by name."""
        ...
    def positions(self, every: float = 0.1) -> Stream[dict[str, float]]:
        """Where the axes are, by name, every so many seconds until the move has ended; last, where it ended.

        Raises:
            RequestFailed, MotionError: what the move raises.
        """
        ...
    seen: bool
    @property
    def skew(self) -> float | None:
        """Seconds between the first and the last frame that started one of them; None before all have started. Where it
        has failed, of those that had started, if there were two.
        """
        ...
    started_at: float | None
    state: MoveState
    def wait(self, timeout: float | None = None) -> dict[str, float]:
        """Wait for its end, and return its result.

        A terminal or a notebook shows how far it is. Ctrl-C stops the motors first, and is raised when they stand.

        Args:
            timeout: seconds; None for as long as it takes.

        Raises:
            LimitExceeded, TypeError: the timeout is no number. It goes on.
            RequestFailed, MotionError: why it failed.
            TimeoutError: it has not ended yet. It goes on: `cancel()` or `stop()` ends it.
        """
        ...

class GroupSetpoint:
    """What a stream of several axes is told: `setpoint(x=90.0, y=-30.0)`. Speeds are rpm.

    Args:
        parts: the set-point of each axis, by name.
    """
    error: Exception | None
    def __call__(self, **rpm: float) -> None:
        """Have the axes that are named turn at these speeds from now on. Those that are not named keep theirs, until
        they are too old.

        Nothing is told while one has failed and the stops of the others are on their way to the wire.

        Raises:
            TypeError: there is no axis of that name, or it is no number.
            LimitExceeded: it is no speed. Nothing is told then.
            MotionError, RequestFailed: what has ended the stream: all axes stand, or their stops are on the wire.
        """
        ...
    @property
    def measured(self) -> dict[str, float | None]:
        """The speeds that were last seen, in rpm."""
        ...
    def reached(self) -> None:
        """Wait until all speeds that are wanted were told, to the end of their ramps. Raises what has ended it."""
        ...
    @property
    def sent(self) -> dict[str, float]:
        """The speeds that were told last, in rpm."""
        ...

class GroupStream:
    """A stream for several axes: `async with group.stream() as setpoint: setpoint(x=90.0, y=-30.0)`.

    Args:
        axes: the axes, by name.
        streams: theirs.
        members: the axes, as those see them that move with them.
    """
    def __enter__(self) -> GroupSetpoint: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: _TracebackType | None) -> Literal[False] | None: ...

class HandleOfSeveral(Generic[T]):
    """One command of each axis of a group. Awaiting it gives what comes of each, by name.

    Args:
        parts: the commands, by name.
    """
    parts: Mapping[str, Handle[T]]
    def add_done_callback(self, callback: Callable[[HandleOfSeveral[T]], object]) -> None:
        """Have `callback` called with this once all have ended, as `Handle.add_done_callback`."""
        ...
    def done(self) -> bool:
        """Whether all have ended, well or not."""
        ...
    error: Exception | None
    def wait(self, timeout: float | None = None) -> dict[str, T]:
        """Wait for its end, and return its result.

        A terminal or a notebook shows how far it is. Ctrl-C stops the motors first, and is raised when they stand.

        Args:
            timeout: seconds; None for as long as it takes.

        Raises:
            LimitExceeded, TypeError: the timeout is no number. It goes on.
            RequestFailed, MotionError: why it failed.
            TimeoutError: it has not ended yet. It goes on: `cancel()` or `stop()` ends it.
        """
        ...

class Table(Generic[T]):
    """Entries that are set (`table[3] = entry`) and asked for (`await table[3]`) by index.

    What was set before is written when the answer comes.

    Args:
        parameters: those of the drive.
        entries: where they are kept.
        values: what is written for an entry.
        typed: the entry that was read.
    """
    def __getitem__(self, index: int) -> T:
        """Ask the drive for an entry."""
        ...
    def __len__(self) -> int:
        ...
    def set(self, index: int, entry: T) -> Handle[None]:
        """Write an entry once what is queued before is done, and read it back.

        Raises:
            IndexError: there is none of that number.
            LimitExceeded: a value is out of its range; nothing is queued.
        """
        ...

class Inputs(Table[DiFunction]):
    """What the inputs do: `inputs[3] = DiFunction.STOP`.

    Where an input may set the motor in motion, its position may change without a command: that is no reason then to
    distrust it, as long as the drive has not restarted.
    """
    def assign(self, *functions: DiFunction) -> Handle[None]:
        """Give all inputs their functions, from DI0 on; `PATHS_BY_INPUTS`, say. What is left out does nothing."""
        ...
    def set_filter(self, coefficient: int) -> Handle[None]:
        """How much of bouncing is filtered out, of all inputs: 0..1024, 2 as shipped. Its unit is not said."""
        ...
    def set_polarity(self, index: int, *, normally_closed: bool) -> Handle[None]:
        """Whether an input is active while its contact is open."""
        ...
    def states(self) -> tuple[bool, ...]:
        """Which are on."""
        ...

class MksSetup(Axis):
    """Settings. Each joins the queue and returns a handle, is kept by the drive when it is switched off, and wears its
    flash (see `Cost`); `set_current(..., save=False)` is the exception.

    Every method raises `LimitExceeded` for a value out of its range, before anything is queued. The handle raises
    `NotStanding` where the motor turns and must not, and what a request can end in (`DeviceRefused`, `NoReply`, ...).
    """
    @property
    def acknowledged(self) -> MksProfile:
        """The settings that the drive has acknowledged to this facade. They cannot be read back."""
        ...
    def check_profile(self, profile: MksProfile) -> None:
        """Refuse a profile of which a value is out of its range. Raises `LimitExceeded`."""
        ...
    def set_close_gains(self, gains: Gains) -> Handle[None]:
        """The gains in the CLOSE modes, each 0..1024 (3.3.2). The motor must stand."""
        ...
    def set_current(self, milliamperes: int, *, save: bool = True) -> Handle[None]:
        """The working current: 0..3000 mA, of a 57D 0..5200 mA (3.2.3).

        Args:
            milliamperes: the current.
            save: whether the drive keeps it. Without, it holds until a restart and spares the flash.
        """
        ...
    def set_enable_level(self, level: EnableLevel) -> Handle[None]:
        """When the En input enables the motor (3.2.6). In the SR modes `enable` does (7.2.2)."""
        ...
    def set_holding_current(self, part: HoldingCurrent) -> Handle[None]:
        """The current at a standstill: 10 to 90 % of the working current (3.2.4)."""
        ...
    def set_homing(self, homing: Homing) -> Handle[None]:
        """What `home()` will do (5.3.2, 5.3.3, 5.3.4). The motor must stand. Limits count from the next homing on.

        `SingleTurnHoming` may take 1.6 s, and is refused while a watchdog on the bus is armed.
        """
        ...
    def set_interpolation(self, on: bool) -> Handle[None]:
        """Whether the drive interpolates to 256 microsteps inside (3.2.9)."""
        ...
    def set_key_lock(self, on: bool) -> Handle[None]:
        """Whether its keys are locked (3.2.13)."""
        ...
    def set_limit_remap(self, on: bool) -> Handle[None]:
        """Whether the limit switches are on En and Dir instead of IN_1 and IN_2 (5.3.1). The motor must stand.

        Without, only a 57D has a right limit (1.2). Limits count from the next homing on.
        """
        ...
    def set_microsteps(self, microsteps: int) -> Handle[None]:
        """Microsteps to a full step: 1..255 (3.2.5). The motor must stand. Moves behind it reckon with them."""
        ...
    def set_mode(self, mode: WorkMode) -> Handle[None]:
        """Who commands the motor, and how it is driven (3.2.2). The motor must stand. The bus moves the SR modes."""
        ...
    def set_overcurrent_protection(self, on: bool) -> Handle[None]:
        """Whether too much current lets go of the shaft (3.4.1). Without, a stalled motor goes on pushing."""
        ...
    def set_position_protection(self, protection: PositionProtection) -> Handle[None]:
        """Whether a position error lets go of the shaft: 0..2.34 turns for 0..983.025 s (3.4.2)."""
        ...
    def set_pulse_direction(self, direction: ParameterDirection) -> Handle[None]:
        """Which way pulses turn the motor (3.2.7). It has no meaning for moves over the bus."""
        ...
    def set_pulse_divider(self, divider: PulseDivider) -> Handle[None]:
        """Toggle OUT_2 every 100..4294967295 pulses; less turns it off (4.3). 57D only, or raises `NotSupported`."""
        ...
    def set_screen_off(self, on: bool) -> Handle[None]:
        """Whether the screen goes dark by itself (3.2.8)."""
        ...
    def set_vfoc_gains(self, gains: Gains) -> Handle[None]:
        """The gains in the vFOC modes, each 0..1024 (3.3.1). The motor must stand."""
        ...
    def write_profile(self, profile: MksProfile) -> Handle[MksProfile]:
        """Write all settings of a profile, in its order. The handle gives what the drive has acknowledged so far.

        It fails with the first setting that is not acknowledged; `profile.differences(axis.acknowledged)` tells then
        what is missing.
        """
        ...

class MksServo(MksSetup):
    """An MKS SERVO drive and its motor.

    A drive that restarts counts from zero where it then stands, and says nothing of it. It is noticed by a jump of the
    position, by the enabling, and by the homing status where an origin was found. One that was set to zero only, left
    several requests unanswered and is found at zero is not trusted (`ReferenceLost`). `home()` where that does not do.

    Args:
        bus: the bus it is on.
        address: 1..247.
        model: which drive; it limits the current, and only a 57D has outputs.
        mode: the work mode it is set to. It cannot be read; `set_mode` sets it. The bus moves it in the SR modes only.
        microsteps: what it is set to, 1..255. At others than 16, 32 and 64 the drive takes speeds for something else
            (7.1); that is compensated for.
        units_per_turn: positions are in units of this many to a turn of the motor; 1 for turns.
        reverse: whether positive is the other way round. Which way the shaft then turns is not promised.
        positive: the direction of 0xF6 and 0xFD in which the position of 0x31 grows. The manual's text and its
            examples disagree (3.1.1, 3.1.2); where `run` goes the other way than `move_to`, it is
            `MotionDirection.CW`.
        limits: lowest and highest position that may be gone to, in units.
        rpm: the speed of moves that name none.
        acceleration: the acceleration of moves that name none: 78.4..20000 rpm/s.
        tolerance: counts (1/16384 turn) by which an axis that has arrived may differ from its target; None for 1°.

    Raises:
        AddressInUse: there is a facade for this address already.
        LimitExceeded, ValueError: an argument is out of its range.
        TypeError: one is of a wrong type.
    """
    address: int
    def __init__(self, bus: Bus, address: int, *, model: Model = ..., mode: WorkMode = ..., microsteps: int = 16, units_per_turn: float = 1.0, reverse: bool = False, positive: MotionDirection = ..., limits: tuple[float, float] | None = None, rpm: float = 300.0, acceleration: float = 1000.0, tolerance: int | None = None) -> None:
        ...
    def angle_error(self) -> float:
        """By how much the shaft differs from where it should be, in degrees (3.1.5)."""
        ...
    def calibrate(self, *, timeout: float = 60.0) -> Handle[None]:
        """Calibrate the encoder (3.2.1). The shaft must be free: it turns by itself, and the drive restarts.

        Whether it succeeded cannot be read; the screen tells (`alarms.AFTER_CALIBRATION`). Then `enable` and home.

        Args:
            timeout: seconds after which a drive that has not come back makes the handle raise `MotionError`.
        """
        ...
    def clear_fault(self) -> Handle[None]:
        """End the state of a stall (3.4.4), the one fault that the drive reports. Raises `MotorStalled` if it lasts.

        The motor then holds again where the drive says `enabled`.
        """
        ...
    def counts(self) -> int:
        """The coordinate: 48 bits, 0x4000 counts a turn (3.1.2). `position` is this in the axis' units."""
        ...
    counts_per_turn: float
    def enabled(self) -> bool:
        """Whether the motor is energised (3.1.6)."""
        ...
    def encoder(self) -> Encoder:
        """The encoder as carry and value (3.1.1)."""
        ...
    def enter_boot(self) -> Handle[None]:
        """Restart the drive into its boot mode, where it waits for firmware (3.6). It answers no Modbus from then on.

        The motor must stand; `silence` all other drives first. Switched off and on, it works as before.
        """
        ...
    def factory_reset(self, *, timeout: float = 10.0) -> Handle[None]:
        """Make all settings those of the factory, and restart (3.5.1). As `restart` otherwise.

        Do it with no other drive on the pair: whether address and baud rate are reset, too, only hardware tells, and
        then it answers at address 1 and 38400 bit/s. Work mode and microsteps are written again before it moves.
        """
        ...
    def home(self, homing: Homing | None = None, *, timeout: float = 60.0) -> Move:
        """Find the origin, and make it zero (5.1).

        Args:
            homing: `SwitchHoming`, `StopHoming` or `SingleTurnHoming`; None for what the drive is set up for.
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.

        Raises:
            LimitExceeded: a value is out of its range; nothing is queued.
            TypeError: one is of a wrong type; nothing is queued.
        """
        ...
    def homed(self) -> Homings:
        """How the homings stand (3.1.7)."""
        ...
    def inputs(self) -> Inputs2:
        """The levels of the ports (4.1). With remapped limits IN_1 is En and IN_2 is Dir."""
        ...
    @property
    def microsteps(self) -> int:
        """The microsteps, as far as is known: they cannot be read."""
        ...
    @property
    def mode(self) -> WorkMode:
        """The work mode, as far as is known: it cannot be read."""
        ...
    @property
    def model(self) -> Model:
        """Which drive it is."""
        ...
    def motor_status(self) -> Status:
        """What the motor does (7.2.1). Some drives have been seen stuck at "slowing down" while they stand."""
        ...
    def move_by_counts(self, counts: int, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go so many counts, by a relative command (9.3). As `move_by_pulses`, for -2147483648..2147483647 counts.

        It also goes where `move_to` and `move_by` cannot: beyond the 32 bits of an absolute target.
        """
        ...
    def move_by_pulses(self, pulses: int, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go so many pulses, by a relative command (9.1). `move_by` is safer: it can be said twice.

        Pulses are 200 times the microsteps a turn, counts 0x4000 a turn; both have the sign of positions. Whether the
        drive counts both in the same direction only hardware tells: where it does not, such a move fails.

        Where its answer is lost, it is said again only if status and position show that it was not taken. A move too
        short to tell raises `OutcomeUnknown` then, and the axis moves only after `enable()`.

        Args:
            pulses: -4294967295..4294967295, not 0.
            rpm: the speed, above 0.
            acceleration: in rpm/s; infinity for a jump.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is queued.
        """
        ...
    def move_to_pulses(self, pulses: int, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go to a position counted in pulses from zero (9.2): -2147483648..2147483647. Else as `move_to`."""
        ...
    def pulses(self) -> int:
        """The pulses received, 200 times the microsteps a turn, as 32 bits without a sign (3.1.4)."""
        ...
    def release_stall(self) -> Handle[None]:
        """The same as `clear_fault`."""
        ...
    def restart(self, *, timeout: float = 10.0) -> Handle[None]:
        """Start the drive anew (3.5.2). It counts from zero then: `enable`, and `home` or `set_zero`. As `calibrate`
        otherwise.
        """
        ...
    def retarget(self, position: float, *, rpm: float | None = None, acceleration: float | None = None) -> Handle[None]:
        """Change target, speed and acceleration of the `move_to` or `move_by` under way, without a stop.

        The move keeps its handle, and is done where it goes now. The handle returned is done once the drive took the
        change. Arguments as for `move_to`.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is sent.
            MotionError: no such move is under way (`move.state` is not `MoveState.MOVING`).
        """
        ...
    def return_to_zero(self, *, timeout: float = 60.0) -> Move:
        """Go straight to the coordinate zero, at the drive's own speed (5.2). The motor must be enabled.

        Args:
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.
        """
        ...
    def running(self) -> Status:
        """The former name of `motor_status`: it is true for a standing motor, too."""
        ...
    def set_heartbeat(self, seconds: float) -> Handle[None]:
        """The time after which the drive stops its motor where it hears nothing: 0 (off) to 4294967.295 s (3.2.14).

        `watchdog` sets it and keeps it fed; where it is set like this, nobody feeds it.

        Raises:
            LimitExceeded: out of range; nothing is queued. Awaited, `MotionError`: a watchdog block sets it.
        """
        ...
    def set_outputs(self, *, out_1: bool | OutputMask = ..., out_2: bool | OutputMask = ...) -> Handle[None]:
        """Set the outputs of a 57D (4.2). They fall back at power-off.

        Args:
            out_1: its level, or what else is done with it. The manual has two ways not to write one, `LEAVE` (the
                default there, too) and `HOLD`; whether they differ only hardware tells.
            out_2: the same.

        Raises:
            NotSupported: another drive than a 57D; nothing is queued.
        """
        ...
    def set_power_on_run(self, on: bool, *, while_running: bool = False) -> Handle[None]:
        """Whether the drive runs by itself when it is switched on, as its last speed command said (8.3).

        **It will then turn without anybody telling it to.** The motor must stand: `run`, `stop`, then this. Whether a
        drive still knows its last speed command then only hardware tells; try it with a free shaft.

        Args:
            on: whether it does.
            while_running: send it while the motor turns, as 8.5 logs it; the motor then slows down and stops.
        """
        ...
    def silence(self) -> Handle[None]:
        """Have the drive answer nothing, so that another one's firmware can be loaded, until `wake` (3.6).

        The motor must stand. The drive cannot be stopped over the bus meanwhile.
        """
        ...
    def stalled(self) -> bool:
        """Whether the drive has noticed a stall (3.4.3)."""
        ...
    def status(self) -> MksStatus:
        """All that tells how the drive is."""
        ...
    def version(self) -> int:
        """The version of the firmware, 32 bits of which the manual gives no layout (3.1.8)."""
        ...
    def wake(self) -> Handle[None]:
        """Have a silent drive answer again (3.6), also one that some other program silenced."""
        ...

class Move(Cancellable[float]):
    """A move that was asked for. Awaiting it gives the position reached, in the axis' units.

    `async with move:` waits for it at the end of the block, and stops the axis if the block is left by an exception.

    Args:
        what: names it in messages.
        target: where it goes, in the axis' units; None where it goes on or the drive decides.
        position: asks the axis where it is.
        cancel: stops the axis on behalf of this move.
        unseen: told of its failure, as a `Handle` is.
    """
    target: float | None
    state: MoveState
    rpm: float | None
    acceleration: float | None
    started_at: float | None
    eta: float | None
    def cancel(self) -> None:
        """End the move: one that waits leaves the queue, one under way stops the axis. It raises `MoveCancelled`."""
        ...
    def positions(self, every: float = 0.1) -> Stream[float]:
        """Where the axis is, every so many seconds until the move has ended; last, where it ended.

        Raises:
            MotionError: what the move raises.
        """
        ...

class Outputs(Table[DoFunction]):
    """What the outputs tell: `outputs[1] = DoFunction.IN_POSITION`."""
    def force(self, which: int, on: bool) -> Handle[None]:
        """Switch the output whose function is `DoFunction.FORCED_1`, 2 or 3."""
        ...
    def set_polarity(self, index: int, *, normally_closed: bool) -> Handle[None]:
        """Whether an output is open while it tells something."""
        ...
    def states(self) -> tuple[bool, ...]:
        """Which are on."""
        ...

class PairSetpoint:
    """What a stream of both wheels is told: `setpoint(60.0, 40.0)`, in rpm, positive the way the wheels count."""
    streamer: Streamer | None
    def __call__(self, left: float, right: float) -> None:
        """Turn at these speeds from now on. It replaces the ones before, and never waits.

        They are approached by the ramp of the stream, both in proportion. What is faster than a wheel can turn is cut,
        of both by the same part.

        Raises:
            LimitExceeded, TypeError: one is no speed.
            MotionError, RequestFailed: what has ended the stream.
        """
        ...
    @property
    def delay(self) -> float:
        """How old the newest set-point was when its frame was sent, in seconds."""
        ...
    @property
    def measured(self) -> tuple[float, float]:
        """The speeds that were last seen, in rpm."""
        ...
    def reached(self) -> None:
        """Wait until the speeds that are wanted were told, to the end of their ramp. Raises what has ended it."""
        ...
    @property
    def sent(self) -> tuple[float, float]:
        """The speeds that were told last, in rpm: on a ramp, a step of them."""
        ...

class PairStream:
    """A stream of set-points of both wheels. Made by `Zlac8015d.stream`.

    Args:
        drive: the drive.
        wheels: the left and the right one.
        queue: queues it for both, given what begins it when both have come to it.
        stop: stops both.
        timeout: seconds after which a set-point is too old.
        acceleration: rpm/s of a wheel, up and down.
        needs: seconds that a change of both speeds, in rpm and in the drive's directions, takes at least; None for what
            the acceleration makes of it.
    """
    def __enter__(self) -> PairSetpoint: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: _TracebackType | None) -> Literal[False] | None: ...

class Paths(Table[Path]):
    """The 16 paths.

    Args:
        parameters: those of the drive.
        to_counts: from units of the axis to pulses.
        to_units: and back.
    """
    def set_mode(self, mode: PathMode) -> Handle[None]:
        """Whether their targets are distances, as shipped, or positions (3.2.2)."""
        ...
    def set_trigger(self, trigger: PathTrigger) -> Handle[None]:
        """Whether a trigger interrupts a positioning under way, as shipped, or is ignored (3.2.2)."""
        ...

class Setpoint:
    """What a stream is told: `setpoint(90.0)`. Speeds are rpm, positive the way the axis counts.

    Args:
        move: the stream, as a command of its axis.
        sign: -1 where the axis counts the other way than its drive.
        state: what is known of it.
        running: what tells the speeds, once it does.
        check: raises what is no speed.
    """
    def __call__(self, rpm: float) -> None:
        """Turn at a speed from now on; 0 to stand. It replaces the one before, and never waits.

        A speed is approached by the ramp of the stream. What is faster than the motor can turn is cut.

        Raises:
            LimitExceeded, TypeError: it is no speed.
            MotionError, RequestFailed: what has ended the stream.
        """
        ...
    @property
    def count(self) -> int:
        """How many set-points were told; newer ones have taken the place of the others."""
        ...
    @property
    def delay(self) -> float:
        """How old the newest set-point was when its frame was sent, in seconds."""
        ...
    @property
    def measured(self) -> float | None:
        """The speed that was last seen, in rpm."""
        ...
    def reached(self) -> None:
        """Wait until the speed that is wanted was told, to the end of its ramp. Raises what has ended the stream."""
        ...
    @property
    def sent(self) -> float:
        """The speed that was told last, in rpm: on a ramp, a step of it."""
        ...

class SetpointStream:
    """A stream of set-points: `async with axis.stream() as setpoint: setpoint(90.0)`.

    Args:
        begin: queues it, with what is called when it begins and what is waited for before; it gives the stream as a
            command, and the set-point.
        running: what tells the speeds, once it does.
        stop: stops the axis.
        stopped: waits for the end of a stop that is under way.
    """
    def __enter__(self) -> Setpoint: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: _TracebackType | None) -> Literal[False] | None: ...

class SpeedPaths(Table[SpeedPath]):
    """The 16 speed paths.

    Args:
        parameters: those of the drive.
        sign: 1, or -1 where the axis counts the other way round.
    """

class TlrSetup(Axis):
    """Settings. Each joins the queue and returns a handle. What is written is read back.

    Every method raises `LimitExceeded` for a value out of its range, before anything is queued. The handle raises what
    a request can end in (`DeviceRefused`, `NoReply`, ...).
    """
    def factory_reset(self) -> Handle[None]:
        """Set everything as it was shipped, the station and the baud rate too.

        The axis then needs `enable()`, and `home()` or `set_zero()`. Raises `OutcomeUnknown` if the answer is lost.
        """
        ...
    def read(self, register: Register[T]) -> T:
        """Ask for any parameter: `await stepper.read(registers.INPUT_FILTER)`. Settings queued before are done then."""
        ...
    def save(self) -> Handle[None]:
        """Have the drive keep what it is set to when it is switched off. Raises `ReferenceLost` if it restarts then."""
        ...
    def set_baudrate(self, baudrate: BaudRate) -> Handle[None]:
        """Its baud rate while SW5 is on. When it counts is not said, as for `set_station`; open the bus at it then."""
        ...
    def set_direction(self, *, reverse: bool) -> Handle[None]:
        """Which way the shaft turns. Positions then mean something else: home the axis, or set its zero."""
        ...
    def set_limit_stop(self, how: LimitStop) -> Handle[None]:
        """What a limit switch does to the motor."""
        ...
    def set_operating_mode(self, mode: OperatingMode) -> Handle[None]:
        """Whether its loop is closed. It counts after `save()` and a power cycle; TLO drives have no encoder."""
        ...
    def set_serial_format(self, serial_format: SerialFormat) -> Handle[None]:
        """Its parity and stop bits. When they count is not said, as for `set_station`; open the bus with them then."""
        ...
    def set_soft_limits(self, low: float | None = None, high: float | None = None) -> Handle[None]:
        """Let the drive itself stop at two positions, in units of the axis; without them it does so no more.

        They count only once the drive was homed since it was switched on (3.5.3).

        Raises:
            ValueError: one of them is missing, or the higher one comes first.
        """
        ...
    def set_station(self, unit: int) -> Handle[None]:
        """Its address while SW1 to SW4 are off: 1..247 (the manual has 0 to 254; Modbus ends at 247).

        Whether it counts at once or after `save()` and a power cycle is not said. Make a new `TlrStepper` for it then.
        If the answer is lost, `OutcomeUnknown` is raised: ask for it at both addresses.

        Raises:
            AddressInUse: there is a facade for that address on this bus; or, when awaited, somebody answers there. Two
                drives at one address cannot be told apart any more, and both do what one is told. Nothing is changed.
            NotStanding: when awaited: the motor turns.
        """
        ...
    def set_subdivision(self, pulses: int) -> Handle[None]:
        """Pulses a turn: 400..51200. Positions then mean something else: home the axis, or set its zero.

        It holds from then on, whatever `pulses_per_turn` the axis was made with.
        """
        ...
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
        ...

class TlrStepper(TlrSetup):
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
        deceleration: the same for slowing down; None for as fast as it gets faster.
        start_rpm: the speed at which moves begin: 0..3000.
        tolerance: pulses by which an axis that has arrived may differ from its target; None for 1°.
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
    address: int
    deceleration: float | None
    paths: Paths
    speed_paths: SpeedPaths
    inputs: Inputs
    outputs: Outputs
    def __init__(self, bus: Bus, address: int, *, pulses_per_turn: int | None = None, units_per_turn: float = 1.0, reverse: bool = False, limits: tuple[float, float] | None = None, rpm: float = 300.0, acceleration: float = 2000.0, deceleration: float | None = None, start_rpm: int = 0, tolerance: int | None = None, clear_trigger: bool = True, block_writes: bool = True, keeps_target: bool = True, enabled_bit: bool = False, live_jog: bool = False, ramp_rpm: float | None = None) -> None:
        ...
    def clear_alarm(self) -> Handle[None]:
        """The same as `clear_fault`."""
        ...
    def clear_fault(self) -> Handle[None]:
        """End an alarm whose cause is gone (3.6). The motor is held again after `enable()`.

        Raises:
            DriveFault: it is still there. It says what to do, and whether the drive must be switched off and on.
        """
        ...
    def home(self, homing: Homing2 | None = None, *, timeout: float = 60.0) -> Move:
        """Find the origin. Positions can be trusted then, and soft limits count.

        The handle gives the position reached: 0, unless there is an offset.

        Args:
            homing: how; None for what the drive is set to.
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.

        Raises:
            LimitExceeded: a value is out of its range; nothing is queued.
            TypeError: one is of a wrong type; nothing is queued.
        """
        ...
    def move_by(self, distance: float, *, rpm: float | None = None, acceleration: float | None = None, deceleration: float | None = None) -> Move:
        """Go a distance. As `Axis.move_by`, with a ramp down of its own, as `move_to`."""
        ...
    def move_to(self, position: float, *, rpm: float | None = None, acceleration: float | None = None, deceleration: float | None = None) -> Move:
        """Go to a position. As `Axis.move_to`, with a ramp down of its own (3.1.1).

        Args:
            position: in the axis' units.
            rpm: the speed, above 0.
            acceleration: in rpm/s; infinity for a jump.
            deceleration: the same for slowing down; None for the axis' own, or as fast as it gets faster.
        """
        ...
    def release(self) -> Handle[None]:
        """Let go of the shaft, once what is queued before it is done and the motor stands. The same as `disable`."""
        ...
    def retarget(self, position: float, *, rpm: float | None = None, acceleration: float | None = None) -> Handle[None]:
        """Change target, speed and acceleration of the `move_to` or `move_by` under way, without a stop.

        The move keeps its handle, and is done where it goes now. The handle returned is done once the drive took the
        change. Arguments as for `move_to`.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is sent.
            MotionError: no such move is under way (`move.state` is not `MoveState.MOVING`).
        """
        ...
    def run(self, rpm: float, *, acceleration: float | None = None, deceleration: float | None = None, duration: float | None = None, replace: bool = False) -> Move:
        """Turn at a speed. As `Axis.run`, with a ramp down of its own, as `move_to`.

        The drive knows no time, and does not notice when nobody is there to stop it: for a `duration` it is sent to
        where it should be then, within the axis' `limits`.
        """
        ...
    def set_up(self) -> None:
        """Ask for what must be known before anything else, if that is not known. Every verb and question does so."""
        ...
    def status(self) -> TlrStatus:
        """What the drive reports."""
        ...
    def version(self) -> Version:
        """What the drive runs. The two columns are swapped in 3.5.1; the names are taken."""
        ...

class Unit(DataFunctions, DiagnosticFunctions):
    """One device, as plain Modbus: all public functions of the specification, with pymodbus' method names.

    Every method takes, by keyword:

    - `timeout`: how long it may take, in seconds, from the call to its end: what still waits then is not sent, what is
      on the wire is not waited for any longer. 0 or less is over at once; None or infinity is no limit, but that for
      the port, if it is gone, nobody waits longer than 30 s.
    - `repeat`: whether it may be sent again when no reply comes: SAFE (what changes nothing), NEVER (what does), or
      VERIFY (a read-back tells whether it happened).
    - `urgency`: its place among the others, COMMAND unless it is said.
    - `reply_timeout`: how long the device may take to begin its answer, in seconds (0.001..10).
    - `pause`: how long the pair is quiet before the request, in seconds (0..1), where that is more than usual.

    The latter two hold for all requests where they are given to `bus.unit`. What would take the pair for longer than
    an armed watchdog allows is not sent.

    Every method raises `DeviceRefused`, `NotSent` (and what is derived from it), `NoReply` or `OutcomeUnknown`; and,
    before anything is sent, `ValueError` where an argument is out of its range and `TypeError` where it is of a wrong
    type.
    """
    highest: int
    address: int
    @overload
    def read(self, register: Register[T], *, gap: int = ..., combine: bool | None = ..., **options: Unpack[RequestOptions]) -> T:
        ...
    @overload
    def read(self, first: Register[A], second: Register[B], *, gap: int = ..., combine: bool | None = ..., **options: Unpack[RequestOptions]) -> tuple[A, B]:
        ...
    @overload
    def read(self, first: Register[A], second: Register[B], third: Register[C], *, gap: int = ..., combine: bool | None = ..., **options: Unpack[RequestOptions]) -> tuple[A, B, C]:
        ...
    @overload
    def read(self, *registers: Register[Any], gap: int = ..., combine: bool | None = ..., **options: Unpack[RequestOptions]) -> tuple[Any, ...]:
        ...
    def request(self, function: int, data: bytes = ..., *, reply: Reply, writes: bool = True, **options: Unpack[RequestOptions]) -> bytes:
        """Send a request by any function (1..127), a private one say; return the data of its answer.

        Args:
            function: the function code.
            data: what follows it, without the CRC.
            reply: how many bytes of data the answer has after the function code; or "counted" where its first byte
                tells how many follow it, "echo" where it repeats the request, a function that tells the number from
                the first bytes of the data (0 while it cannot be told yet), or None where nobody answers.
            writes: False for what changes nothing in the device: that is repeated when it is lost.
            options: as for every request.
        """
        ...
    def write(self, register: Register[T], value: T, *, function: Literal[6, 16] | None = None, **options: Unpack[RequestOptions]) -> None:
        """Write the typed value of a register, checked against its range. `repeat` as for `write_register`.

        Args:
            register: made like `Register("level", F32, "mm", 0, 500, address=40)`.
            value: in the register's unit.
            function: 16 where the device takes no other, 6 for one register; None for 6 where it is one.
            options: as for every request.
        """
        ...

class VehicleSetpoint:
    """What a stream of a vehicle is told: `setpoint(v, omega)`, in m/s and rad/s."""
    def __call__(self, v: float, omega: float) -> None:
        """Go ahead at `v` and turn at `omega` from now on. It replaces what was told before, and never waits.

        Raises:
            LimitExceeded, TypeError: one is no speed.
            MotionError, RequestFailed: what has ended the stream.
        """
        ...
    @property
    def delay(self) -> float:
        """How old the newest set-point was when its frame was sent, in seconds."""
        ...
    @property
    def measured(self) -> tuple[float, float]:
        """How fast it was last seen to go and to turn."""
        ...
    def reached(self) -> None:
        """Wait until the speeds that are wanted were told, to the end of their ramp. Raises what has ended it."""
        ...
    @property
    def sent(self) -> tuple[float, float]:
        """What was told last: on a ramp, a step of it."""
        ...

class VehicleStream:
    """A stream of set-points of a vehicle. Made by `DifferentialDrive.stream`."""
    def __enter__(self) -> VehicleSetpoint: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: _TracebackType | None) -> Literal[False] | None: ...

class WatchdogGuard:
    """An async context manager over the watchdogs of some devices. Made by `axis.watchdog` and `bus.watchdog`.

    It may be entered again after it was left: each time it has its own lease and its own report, and restores what the
    watchdogs were set to when it was entered.
    """
    timeout: float
    def renew(self) -> None:
        """The application is alive: the lease, if there is one, holds from now on.

        Raises:
            NotGuarding: the block was not entered, or was left.
        """
        ...
    def report(self) -> list[WatchReport]:
        """How each device has been fed so far, trips included; after the block, until it was left.

        A device whose margin falls under a quarter is logged as a warning, too, once, by "rs485bus".
        """
        ...
    def __enter__(self) -> Self: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: _TracebackType | None) -> Literal[False] | None: ...

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
    bus: Bus
    address: int
    name: str
    left: ZlacWheel
    right: ZlacWheel
    def __init__(self, bus: Bus, address: int, *, units_per_turn: float = 1.0, reverse: tuple[bool, bool] = ..., limits: tuple[float, float] | None = None, rpm: float = 60.0, acceleration: float = 120.0, max_rpm: float = 1000.0, tolerance: int = 16, encoder_lines: int | None = None, speed_resolution: int | None = None, status_word_left: Literal['low', 'high'] = 'low', ramp_rpm: float | None = None, smooth_stop: bool = False, scaled_position_speed: bool = False, zero_in_position_mode: bool = False) -> None:
        ...
    def clear_fault(self) -> Both[None]:
        """The same as `clear_faults`, as all families call it."""
        ...
    def clear_faults(self) -> Both[None]:
        """Clear the errors of both wheels. They are released then: `enable()`.

        Raises, when awaited:
            DriveFault: what caused them is still there.
        """
        ...
    def drain(self) -> None:
        """Wait until nothing is queued or on its way to a target, of either wheel."""
        ...
    def emergency_stop(self) -> Handle[None]:
        """Stop both wheels as fast as the drive can, see them stand, and drop what is queued. Then `enable()`."""
        ...
    def enable(self) -> Both[None]:
        """Hold both wheels, so that they take commands. Nothing that they were told before goes on.

        After an emergency stop, a trip, or a stop that was not confirmed, its first frame is a stop.
        """
        ...
    def move_by(self, left: float, right: float, *, rpm: float | None = None, acceleration: float | None = None) -> Both[float]:
        """Send both wheels a way, started by one frame. Arguments and errors as for an axis."""
        ...
    def move_to(self, left: float, right: float, *, rpm: float | None = None, acceleration: float | None = None) -> Both[float]:
        """Send both wheels to positions, started by one frame. Arguments and errors as for an axis."""
        ...
    def parameter(self, register: Register[T]) -> T:
        """What one of `registers` holds."""
        ...
    def parameters(self, side: Side) -> dict[str, float]:
        """All parameters of one motor, by name, in their units."""
        ...
    def release(self) -> Both[None]:
        """Let go of both wheels, once what is queued is done and they stand. They can be turned then, and roll away."""
        ...
    def run(self, left: float, right: float, *, acceleration: float | None = None, duration: float | None = None, replace: bool = False) -> Both[float]:
        """Turn both wheels at speeds, in rpm, told by one frame. Arguments and errors as for an axis.

        Args:
            left: the left wheel's speed.
            right: the right wheel's speed.
            acceleration: rpm/s.
            duration: seconds; None to go on until told otherwise.
            replace: do not wait until the pair has the speeds told before. Such a run ends as done; one that has not
                begun is cancelled.
        """
        ...
    def set_brakes(self, left: Brake, right: Brake) -> Both[None]:
        """Open or close the external brakes, once both wheels stand (3.6). The drive saves it in its EEPROM: a brake
        that works with every stop is better wired to an output (0x201C, 0x201D).
        """
        ...
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
        ...
    def set_up(self) -> ZlacSetup:
        """Set the drive up now instead of before the first command, and say what was found."""
        ...
    def set_zero(self) -> Both[None]:
        """Make the positions at which both wheels then stand their zeros."""
        ...
    def snapshot(self) -> Snapshot:
        """Counts, speeds, torques, errors and status word of both wheels at one moment, in the drive's own terms."""
        ...
    @property
    def speed_resolution(self) -> int:
        """Steps to one rpm (0x2022), as far as is known: what was asked for, or 1, before it was set up."""
        ...
    def status(self) -> ZlacStatus:
        """What the drive reports. The wheels are of one moment."""
        ...
    def stop(self) -> Handle[None]:
        """Stop both wheels, with the ramp where they run at speeds; see them stand, and drop what is queued."""
        ...
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
        ...
    def torque(self, left: int, right: int, *, slope: int | None = None) -> Both[float]:
        """Push with both wheels, in mA, told by one frame. Arguments and errors as for a wheel."""
        ...
    def watchdog(self, timeout: float, *, lease: float | None = None) -> WatchdogGuard:
        """Guard both wheels by the drive's own watchdog while a block runs. As `Bus.watchdog`."""
        ...

class ZlacWheel(Axis):
    """One wheel. Made by `Zlac8015d`, as its `left` and its `right`.

    A `move_by` beyond what an absolute target may be (0x3FFFFFFF counts either way) is sent as a distance, which may be
    0x7FFFFFFF counts long.

    What it cannot do alone, because the drive cannot: `enable()`, `disable()` and every stop out of position or torque
    mode concern the other wheel, too; and while the other one keeps a speed or a torque, this one can do only the same.
    The drive does not time a `run`: the end of its duration is told when it has come, so that the wheel goes on turning
    if this program ends before, unless a watchdog guards it.

    A wheel has no origin to find, and so no `home()`: drive it to where its zero is to be, then `set_zero()`.
    """
    other: ZlacWheel
    side: Side
    def clear_fault(self) -> Both[None]:
        """Clear the errors of the drive: the drive can clear those of both wheels only. Both are released then:
        `enable()`.

        Raises, when awaited:
            DriveFault: what caused them is still there.
        """
        ...
    def drain(self) -> None:
        """Wait until nothing is queued or on its way to a target, of either wheel: what guards one guards both."""
        ...
    def enable(self) -> Handle[None]:
        """Hold both wheels, so that they take commands. Nothing that they were told before goes on.

        After an emergency stop, a trip, or a stop that was not confirmed, its first frame is a stop.
        """
        ...
    def status(self) -> WheelStatus:
        """What the drive reports of this wheel; `Zlac8015d.status` tells what it reports of itself, too."""
        ...
    def torque(self, milliamperes: int, *, slope: int | None = None) -> Move:
        """Push with a torque, given as a current, until told otherwise. Done once the drive was told.

        Only the load limits the speed then, and 0 lets the wheel roll. `stop()` stops it.

        Args:
            milliamperes: -30000..30000.
            slope: 0..65535 mA/s with which it is reached; None for what the drive is set to.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is queued.
        """
        ...

class Plant:
    """The buses, axes, groups and the vehicle of a plant file, open while a block runs.

        with blocking.Plant.load("plant.toml") as plant:
            plant.x.home().wait()

    As `rs485bus.Plant` otherwise.

    Args:
        file: what it is.
        sim: put virtual drives on virtual lines instead of opening ports.
        watchdogs: guard the axes whose entries say so.
    """
    def __init__(self, file: PlantFile, *, sim: bool = False, watchdogs: bool = True) -> None:
        ...
    def emergency_stop(self) -> dict[str, EmergencyReport]:
        """Stop every drive on every bus at once. Returns the reports, by the names of the buses."""
        ...
    @classmethod
    def load(cls, path: str | PathLike[str], *, sim: bool = False, watchdogs: bool = True) -> Self:
        """Read a plant file. Arguments as for the class.

        Raises:
            PlantFileError: it has mistakes. The message says where, and what to do.
        """
        ...
    def __getattr__(self, name: str) -> Any: ...
    def __enter__(self) -> Self: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: _TracebackType | None) -> Literal[False] | None: ...
