"""The simulated TL-R does what its manual says to plain frames, without the facade."""

import random
from typing import Any
from unittest.mock import DEFAULT, Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus.devices.tlr import DiFunction, OperatingMode
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.frames import read, words, write
from rs485bus.sim import Dip, SimTlr, TlrMachine
from rs485bus.sim.motor import Motor
from rs485bus.wire.frames import payload
from rs485bus.wire.registers import Block, Register


class Master:
    """Asks one drive, on a clock that is moved by hand."""

    def __init__(self, sim: SimTlr) -> None:
        self.sim = sim
        self.now = 10.0

    def put(self, first: int, *values: int) -> int:
        """Write; returns the exception code, 0 if there is none."""
        self.now += 0.01
        reply = self.sim.receive(write(self.sim.address, first, values).adu, self.now)
        assert reply is not None
        return reply[2] if reply[1] & 0x80 else 0

    def get(self, what: Register[Any] | Block) -> tuple[int, ...]:
        self.now += 0.01
        reply = self.sim.receive(read(self.sim.address, what).adu, self.now)
        assert reply is not None
        return words(payload(reply))

    def wait(self, seconds: float) -> "Master":
        self.now += seconds
        return self

    @property
    def position(self) -> int:
        high, low = self.get(r.POSITION)
        return int.from_bytes(bytes((high >> 8, high & 0xFF, low >> 8, low & 0xFF)), "big", signed=True)


def master(**options: object) -> Master:
    return Master(SimTlr(**options))  # type: ignore[arg-type] # options of SimTlr


BLOCK = (0, 100, 100, 600)


@pytest.mark.parametrize("trigger", ["edge", "write"])
def test_the_position_mode_of_3_1_relative_and_absolute(trigger: str) -> None:
    m = master(trigger=trigger)
    assert m.put(0x33, *BLOCK, 0, 4000) == 0
    for expected in (4000, 8000):
        m.put(0x4E, 0)
        assert m.put(0x4E, 1) == 0
        assert m.get(r.STATUS)[0] & 4
        assert m.wait(1.0).position == expected
        assert m.get(r.STATUS)[0] & 5 == 1
    m.put(0x4E, 0)
    m.put(0x4E, 3)
    assert m.wait(1.0).position == 4000


@pytest.mark.parametrize(("trigger", "moves"), [("edge", 1), ("write", 2)])
def test_a_trigger_that_is_not_cleared_counts_once_or_each_time(trigger: str, moves: int) -> None:
    m = master(trigger=trigger)
    m.put(0x33, *BLOCK, 0, 4000)
    for _ in range(2):
        m.put(0x4E, 1)
        m.wait(1.0)
    assert m.sim.moves == moves
    assert m.position == 4000 * moves
    assert m.get(r.CONTROL)[0] == (1 if trigger == "edge" else 0)


@pytest.mark.parametrize(("word", "expected"), [(3, 40_000), (7, -4000)])
def test_bit_2_interrupts_a_positioning_under_way(word: int, expected: int) -> None:
    m = master()
    m.put(0x33, *BLOCK, 0, 40_000)
    m.put(0x4E, 3)
    m.wait(0.3).put(0x37, 0xFFFF, 0x10000 - 4000)
    m.put(0x4E, word - 1)
    m.put(0x4E, word)
    assert m.wait(5.0).position == expected


def test_a_block_of_five_or_more_is_truncated_by_some_firmware() -> None:
    m = master(truncates=4, admits_truncation=True)
    reply = m.sim.receive(write(1, 0x33, (*BLOCK, 1, 2)).adu, 11.0)
    assert reply is not None
    assert reply[2:6] == bytes((0, 0x33, 0, 4))
    assert m.get(r.TARGET) == (0, 0)
    assert m.put(0x37, 1, 2) == 0
    assert m.get(r.TARGET) == (1, 2)


def test_jog_stop_and_emergency_stop() -> None:
    m = master()
    m.put(0x30, 0x10000 - 600, 500, 500)
    assert m.put(0x4E, 8) == 0
    m.wait(1.0)
    assert m.get(r.SPEED)[0] == 0x10000 - 600
    m.put(0x4E, 0x20)
    m.wait(0.2)
    assert 0x10000 - 600 < m.get(r.SPEED)[0] < 0x10000
    m.wait(0.4)
    assert m.get(r.SPEED)[0] == 0
    m.put(0x4E, 8)
    m.wait(1.0).put(0x4E, 0x40)
    assert m.get(r.SPEED)[0] == 0


def test_the_auxiliary_control() -> None:
    m = master()
    m.put(0x33, *BLOCK, 0, 4000)
    m.put(0x4E, 3)
    assert m.wait(1.0).position == 4000
    m.put(0x4F, 0x0400)
    assert m.position == 0
    m.put(0x4F, 0x0600)
    assert m.get(r.STATUS)[0] & 16 == 0
    m.put(0x4E, 0)
    assert m.put(0x4E, 3) == 4
    m.put(0x4F, 0x0500)
    assert m.get(r.STATUS)[0] & 16
    assert m.put(0x4E, 1) == 0
    assert m.put(0x4F, 0x0700) == 3


def test_the_switches_set_station_and_baud_rate() -> None:
    assert [SimTlr(dip=Dip(unit)).address for unit in range(1, 16)] == list(range(1, 16))
    sim = SimTlr(77, dip=Dip(0, custom_baudrate=True, terminated=True))
    assert (sim.address, sim.baudrate) == (77, 115200)
    m = Master(sim)
    m.put(0x28, 3)
    m.put(0x4F, 0x0200)
    sim.power_cycle(m.now)
    assert sim.baudrate == 9600
    assert sim.receive(read(77, r.STATUS).adu, m.now) is None  # it is not there yet
    assert sim.receive(read(77, r.STATUS).adu, m.now + 1) is not None
    with pytest.raises(ValueError, match=r"station 16 is outside 0\.\.15"):
        Dip(16)


def test_a_power_cycle_brings_back_what_was_saved_and_counts_from_zero() -> None:
    m = master(shaft=2.0)
    m.put(0x1A, 9)
    m.put(0x4F, 0x0200)
    m.put(0x1A, 10)
    m.put(0x33, *BLOCK, 0, 4000)
    m.put(0x4E, 3)
    m.wait(1.0)
    m.sim.power_cycle(m.now, dropped=-0.5)
    m.wait(1.0)
    assert m.get(r.INPUT_FILTER) == (9,)
    assert m.get(r.CONTROL) == (0,)
    assert m.position == 0
    assert m.sim.shaft(m.now) == pytest.approx(2.5)
    m.put(0x4F, 0)
    m.put(0x4F, 0x0100)
    assert m.get(r.INPUT_FILTER) == (2,)


def test_the_position_wraps_at_32_bits() -> None:
    m = master(operating_mode=OperatingMode.OPEN_LOOP, subdivision=51200)
    m.put(0x33, 0, 0, 0, 3000, 0x7FFF, 0xFFFF)
    m.put(0x4E, 3)
    assert m.wait(900.0).position == 0x7FFF_FFFF
    m.put(0x37, 0, 1)
    m.put(0x4E, 0)
    m.put(0x4E, 1)
    assert m.wait(1.0).position == -0x8000_0000


def test_an_input_that_homes() -> None:
    m = master(shaft=0.0, machine=TlrMachine(limits=(-2.0, 2.0)))
    m.put(0x40, 17, 300, 30, 50)
    m.put(0x15, DiFunction.HOME)
    m.sim.close(4, True, m.now)
    m.wait(5.0)
    assert m.get(r.STATUS)[0] & 2
    assert m.position == pytest.approx(0, abs=2)
    assert m.sim.shaft(m.now) == pytest.approx(-2.0, abs=0.001)


@given(
    target=st.floats(-50, 50),
    rpm=st.floats(1, 3000),
    up=st.floats(100, 1e6) | st.just(float("inf")),
    down=st.floats(100, 1e6) | st.just(float("inf")),
    start=st.floats(0, 500),
)
def test_a_motor_with_two_ramps_goes_where_it_should_without_a_jump(
    target: float, rpm: float, up: float, down: float, start: float
) -> None:
    motor = Motor()
    motor.go_to(target, rpm, up, 0.0, down=down, start=start)
    end = motor.arrives_at
    assert motor.position(end) == target
    assert not motor.moving(end)
    # Just before it arrives it is as near as its speed allows.
    assert abs(motor.position(end - 1e-6) - target) <= rpm / 60 * 1e-5 + 1e-9
    assert max((abs(motor.rpm(end * share / 20)) for share in range(20)), default=0.0) <= rpm * (1 + 1e-9)


@given(target=st.floats(-50, 50), place=st.floats(-60, 60), rpm=st.floats(1, 3000))
def test_a_motor_knows_when_it_passes_a_place(target: float, place: float, rpm: float) -> None:
    motor = Motor()
    motor.go_to(target, rpm, 1000.0, 0.0)
    passed = motor.reaches(place, 0.0, motor.arrives_at + 1)
    between = 0 < place <= target or 0 > place >= target
    assert (passed is not None) is between
    if passed is not None:
        assert motor.position(passed) == pytest.approx(place, abs=1e-6)


def test_a_motor_that_turns_round_passes_a_place_on_its_way() -> None:
    motor = Motor()
    motor.run(600, 600.0, 0.0)
    motor.run(-600, 600.0, 1.0)  # it goes on to 10 turns before it comes back
    assert motor.reaches(9.0, 1.0, 10.0) == pytest.approx(2.0 - 0.2**0.5)
    assert motor.reaches(11.0, 1.0, 10.0) is None
    assert motor.reaches(-5.0, 1.0, 10.0) is not None


@pytest.mark.parametrize("seed", [111, 188, 215, 426])
def test_a_shaft_that_is_held_comes_to_where_it_is_held_once(seed: int) -> None:
    rng = random.Random(seed)
    motion = SimTlr(1, machine=TlrMachine(origin=None)).motion
    motion.closed_loop = False
    at = 1000 + rng.uniform(0, 0.3)
    motion.motor.run(rng.choice((-1, 1)) * rng.uniform(20, 300), rng.uniform(200, 5000), at)
    at += rng.uniform(0.01, 0.3)
    motion.advance(at)
    here = motion.shaft(at)
    motion.machine.travel = (here, here) if rng.random() < 0.5 else (here - 0.1, here + 0.5)
    meets = Mock(wraps=motion._meet, side_effect=[DEFAULT] * 500)
    motion._meet = meets  # type: ignore[method-assign]
    for _ in range(40):
        at += rng.uniform(0.001, 0.02)
        motion.advance(at)
        if rng.random() < 0.05:
            motion.motor.run(rng.uniform(-300, 300), rng.uniform(200, 5000), at)
