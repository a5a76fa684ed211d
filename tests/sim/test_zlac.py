"""The virtual ZLAC8015D: what it answers, what it keeps, what its options change."""

import pytest

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.frames import control, read, write, write_twins
from rs485bus.devices.zlac.values import (
    BaudRate,
    Brake,
    ControlMode,
    ControlWord,
    EmergencyShaft,
    Fault,
    Inputs,
    PowerOnShaft,
    ShaftState,
    Side,
    Synchrony,
)
from rs485bus.sim import SimZlac
from rs485bus.wire.frames import BROADCAST, Request, payload, read_input, write_multiple, write_single
from rs485bus.wire.registers import Block, Register


class Bench:
    """A drive that is asked in time."""

    def __init__(self, sim: SimZlac) -> None:
        self.sim = sim
        self.now = 1.0

    def ask(self, request: Request) -> bytes:
        self.now += 0.005
        reply = self.sim.receive(request.adu, self.now)
        assert reply is not None
        return reply

    def say(self, *requests: Request) -> None:
        for request in requests:
            assert self.ask(request).startswith(request.prefix)

    def enable(self, mode: ControlMode = ControlMode.VELOCITY) -> None:
        self.say(write(1, r.MODE, mode), control(1, ControlWord.ENABLE))

    def status(self) -> int:
        return r.STATUS.decode(payload(self.ask(read(1, r.STATUS))))

    def wait(self, seconds: float) -> None:
        self.now += seconds

    def rpm(self) -> tuple[float, float]:
        left, right = self.sim.rpm(self.now)
        return round(left, 3), round(right, 3)


def bench(**options: object) -> Bench:
    return Bench(SimZlac(1, **{"watchdog": 0, **options}))  # type: ignore[arg-type]


@pytest.mark.parametrize("register", r.ALL, ids=lambda register: f"{register.address:04X}")
def test_every_register_of_the_manual_is_answered(register: Register[object]) -> None:
    value = register.decode(payload(bench().ask(read(1, register))))
    if register.access != "r" and register is not r.WATCHDOG:
        assert value == register.default


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (read_input(1, 0x20A2, 1), 1),
        (read(1, Block("gap", 0x2014, (), 2)), 2),
        (read(1, Block("beyond", 0x20B0, (), 2)), 2),
        (write_single(1, 0x20A2, 0), 2),
        (write_single(1, 0x2015, 0), 2),
        (write_single(1, 0x200D, 5), 3),
        (write_single(1, 0x2008, 1001), 3),
        (write_single(1, 0x2000, 0x8000), 3),
    ],
)
def test_what_it_does_not_take_is_refused_with_the_exceptions_of_the_manual(request_: Request, code: int) -> None:
    reply = bench().ask(request_)
    assert reply[1:3] == bytes((request_.function | 0x80, code))


def test_a_frame_of_which_one_register_is_refused_changes_nothing() -> None:
    b = bench()
    b.ask(write_single(1, 0x2080, 700))
    reply = b.ask(write_multiple(1, 0x2080, [1000, 0xFFFF]))
    assert reply[1:3] == bytes((0x90, 3))
    assert b.sim.value(r.ACCELERATION_TIME.left) == 700


def test_a_broadcast_is_not_obeyed() -> None:
    b = bench()
    b.enable()
    b.say(write_twins(1, (r.TARGET_VELOCITY, 100, 100)))
    b.wait(1.0)
    assert b.sim.receive(control(BROADCAST, ControlWord.EMERGENCY_STOP).adu, b.now) is None
    assert b.rpm() == (100, 100)


def test_a_node_id_ends_at_127() -> None:
    with pytest.raises(ValueError, match="node ID"):
        SimZlac(128)


def test_ramps_take_their_time_up_and_down() -> None:
    b = bench()
    b.say(write(1, r.ACCELERATION_TIME.left, 1000), write(1, r.DECELERATION_TIME.left, 200))
    b.enable()
    b.say(write(1, r.TARGET_VELOCITY.left, 100))
    b.wait(0.5)
    assert b.rpm()[0] == pytest.approx(50)
    b.wait(0.6)
    b.say(write(1, r.TARGET_VELOCITY.left, 0))
    b.wait(0.1)
    assert b.rpm()[0] == pytest.approx(50)


def test_ramps_can_be_of_a_change_of_speed() -> None:
    b = bench(ramp_rpm=1000.0)
    b.enable()
    b.say(write(1, r.TARGET_VELOCITY.left, 100))
    b.wait(0.025)
    assert b.rpm()[0] == pytest.approx(50)


def test_the_speed_limit_and_the_resolution_hold() -> None:
    b = bench()
    b.say(write(1, r.SPEED_LIMIT, 150), write(1, r.SPEED_RESOLUTION, 10))
    b.enable()
    b.say(write_twins(1, (r.TARGET_VELOCITY, 1234, 3000)))
    b.wait(2.0)
    assert b.rpm() == (123.4, 150)


@pytest.mark.parametrize(
    ("synchrony", "word", "moves"),
    [
        (Synchrony.ASYNCHRONOUS, ControlWord.START_LEFT, (1, 0)),
        (Synchrony.ASYNCHRONOUS, ControlWord.START_RIGHT, (0, 1)),
        (Synchrony.ASYNCHRONOUS, ControlWord.START_BOTH, (0, 0)),
        (Synchrony.SYNCHRONOUS, ControlWord.START_BOTH, (1, 1)),
        (Synchrony.SYNCHRONOUS, ControlWord.START_LEFT, (0, 0)),
    ],
)
def test_which_start_words_do_something_depends_on_the_way_of_starting(
    synchrony: Synchrony, word: ControlWord, moves: tuple[int, int]
) -> None:
    b = bench()
    b.say(write(1, r.SYNCHRONY, synchrony))
    b.enable(ControlMode.POSITION_ABSOLUTE)
    b.say(write_twins(1, (r.TARGET_POSITION, 4096, 4096)), control(1, word))
    assert b.sim.moves == moves


@pytest.mark.parametrize("resumes", [False, True])
def test_enabling_after_an_emergency_stop_may_go_on_with_the_old_target(resumes: bool) -> None:
    b = bench(enable_resumes=resumes)
    b.enable(ControlMode.POSITION_ABSOLUTE)
    b.say(write(1, r.TARGET_POSITION.left, 40960), control(1, ControlWord.START_LEFT))
    b.wait(1.0)
    b.say(control(1, ControlWord.EMERGENCY_STOP))
    b.wait(1.0)
    assert b.rpm() == (0, 0)
    b.say(control(1, ControlWord.ENABLE))
    b.wait(1.0)
    assert (b.rpm()[0] > 0) == resumes


def test_enabling_in_velocity_mode_goes_on_with_the_old_speed() -> None:
    b = bench()
    b.enable()
    b.say(write(1, r.TARGET_VELOCITY.left, 100))
    b.wait(1.0)
    b.say(control(1, ControlWord.RELEASE))
    b.wait(2.0)
    assert b.rpm() == (0, 0)
    b.say(control(1, ControlWord.ENABLE))
    b.wait(1.0)
    assert b.rpm() == (100, 0)


@pytest.mark.parametrize(("left", "words"), [("low", (0x4041, 0xC040)), ("high", (0x4140, 0x40C0))])
def test_the_halves_of_the_status_word_are_an_option(left: str, words: tuple[int, int]) -> None:
    b = bench(status_word_left=left)
    b.enable()
    b.say(write(1, r.TARGET_VELOCITY.left, 100))
    assert b.status() == words[0]
    b.say(write(1, r.TARGET_VELOCITY.left, 0))
    b.wait(1.0)
    b.sim.fail(Side.RIGHT, Fault.HALL, b.now)
    assert b.status() == words[1]


def test_a_fault_stops_its_wheel_and_keeps_the_drive_from_being_enabled() -> None:
    b = bench()
    b.enable()
    b.say(write_twins(1, (r.TARGET_VELOCITY, 100, 100)))
    b.wait(1.0)
    b.sim.fail(Side.LEFT, Fault.OVER_CURRENT, b.now)
    b.wait(1.0)
    assert b.rpm() == (0, 100)
    b.say(control(1, ControlWord.ENABLE))
    b.wait(1.0)
    assert b.rpm() == (0, 100)
    b.say(control(1, ControlWord.CLEAR_FAULT), control(1, ControlWord.ENABLE))
    b.wait(1.0)
    assert b.rpm() == (100, 100)


def test_its_watchdog_stops_it_in_time_and_any_request_feeds_it() -> None:
    b = bench(watchdog=500)
    b.enable()
    b.say(write_twins(1, (r.TARGET_VELOCITY, 100, 100)))
    for _ in range(10):
        b.wait(0.4)
        b.status()
    assert b.sim.trips == []
    heard = b.now
    b.wait(2.0)
    assert b.rpm() == (0, 0)
    assert b.sim.trips == [pytest.approx(heard + 0.5)]
    assert b.sim.left.state is ShaftState.EMERGENCY_STOP


def test_a_watchdog_of_zero_is_off() -> None:
    b = bench()
    b.enable()
    b.say(write(1, r.TARGET_VELOCITY.left, 100))
    b.wait(100.0)
    assert b.rpm() == (100, 0)


def test_a_power_cycle_keeps_what_was_saved_and_counts_from_zero() -> None:
    b = bench()
    b.enable()
    b.say(write(1, r.TARGET_VELOCITY.left, 100))
    b.say(write(1, r.VELOCITY_KP.left, 600))
    b.say(write(1, r.SAVE_WRITES, True), write(1, r.VELOCITY_KP.right, 700), write(1, r.SAVE_WRITES, False))
    b.say(write(1, r.DRIVE_TEMPERATURE_LIMIT, 70.0), write(1, r.BRAKE.right, Brake.CLOSED))
    b.wait(5.0)
    assert b.sim.left.counts(b.now) > 0
    b.sim.power_cycle(b.now)
    assert b.sim.receive(read(1, r.STATUS).adu, b.now) is None
    b.wait(2.0)
    assert b.status() == 0
    assert b.sim.left.counts(b.now) == 0
    assert b.rpm() == (0, 0)
    assert b.sim.value(r.MODE) is ControlMode.UNDEFINED
    assert b.sim.value(r.TARGET_VELOCITY.left) == 0
    assert (b.sim.value(r.VELOCITY_KP.left), b.sim.value(r.VELOCITY_KP.right)) == (500, 700)
    assert b.sim.value(r.DRIVE_TEMPERATURE_LIMIT) == 70.0
    assert b.sim.value(r.BRAKE.right) is Brake.CLOSED


def test_a_power_cycle_brings_a_new_node_id_and_baud_rate() -> None:
    b = bench()
    b.say(write(1, r.NODE_ID, 9), write(1, r.BAUD_RATE, BaudRate.BAUD_57600))
    b.say(write(1, r.POWER_ON_SHAFT, PowerOnShaft.LOCKED))
    b.sim.power_cycle(b.now)
    assert b.sim.address == 9
    assert b.sim.baudrate == 57600


def test_the_factory_settings_can_be_restored() -> None:
    b = bench()
    b.say(write(1, r.DRIVE_TEMPERATURE_LIMIT, 70.0), write(1, r.RESTORE, True))
    assert b.sim.value(r.DRIVE_TEMPERATURE_LIMIT) == 80.0
    assert b.sim.restarts == 1


def test_writes_go_to_the_eeprom_only_where_they_are_saved() -> None:
    b = bench()
    b.say(write(1, r.TARGET_VELOCITY.left, 1))
    assert b.sim.eeprom_writes == 0
    b.say(write(1, r.SAVE_WRITES, True), write(1, r.TARGET_VELOCITY.left, 2), write(1, r.TARGET_VELOCITY.left, 3))
    assert b.sim.eeprom_writes == 2


@pytest.mark.parametrize(
    ("shaft", "state"),
    [(EmergencyShaft.LOCK, ShaftState.EMERGENCY_STOP), (EmergencyShaft.RELEASE, ShaftState.RELEASED)],
)
def test_the_emergency_stop_input_stops_and_locks_or_releases(shaft: EmergencyShaft, state: ShaftState) -> None:
    b = bench()
    b.say(write(1, r.EMERGENCY_SHAFT, shaft))
    b.enable()
    b.say(write(1, r.TARGET_VELOCITY.left, 100))
    b.wait(1.0)
    b.sim.press(Inputs.X0, b.now)
    b.wait(1.0)
    assert b.rpm() == (0, 0)
    assert b.sim.left.state is state
    b.say(control(1, ControlWord.ENABLE))
    assert b.sim.left.state is state


def test_an_input_without_that_function_does_nothing() -> None:
    b = bench()
    b.enable()
    b.say(write(1, r.TARGET_VELOCITY.left, 100))
    b.wait(1.0)
    b.sim.press(Inputs.X1, b.now)
    assert b.rpm() == (100, 0)


def test_its_counters_wrap() -> None:
    b = bench(counts=(2**31 - 1000, -(2**31) + 1000))
    b.enable()
    b.say(write_twins(1, (r.TARGET_VELOCITY, 60, -60)))
    b.wait(2.0)
    left, right = b.sim.left.counts(b.now), b.sim.right.counts(b.now)
    assert left < 0 < right


def test_clearing_the_counter_and_moving_the_zero_of_targets_are_two_things() -> None:
    b = bench()
    b.enable(ControlMode.POSITION_ABSOLUTE)
    b.say(write(1, r.TARGET_POSITION.left, 8192), control(1, ControlWord.START_LEFT))
    b.wait(5.0)
    b.ask(write_single(1, 0x2005, 1))
    assert b.sim.left.counts(b.now) == 0
    b.say(write(1, r.TARGET_POSITION.left, 0), control(1, ControlWord.START_LEFT))
    b.wait(5.0)
    assert b.sim.left.counts(b.now) == -8192
    b.ask(write_single(1, 0x2006, 1))
    b.say(write(1, r.TARGET_POSITION.left, 4096), control(1, ControlWord.START_LEFT))
    b.wait(5.0)
    assert b.sim.left.counts(b.now) == -4096
