"""The virtual drive answers what the manual logs as the manual logs it, and does what its examples say.

Thirty seconds pass between two requests, as about as many did when they were logged.
"""

import pytest

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read, write, write_block
from rs485bus.devices.mks.values import Homed, Model, MotionDirection, Status, WorkMode
from rs485bus.sim import Machine, SimMks
from rs485bus.wire.frames import payload
from tests.devices.mks.manual import LOGGED, logged

PAUSE = 30.0


class Desk:
    """One drive, asked by plain frames at times."""

    def __init__(self, sim: SimMks) -> None:
        self.sim = sim
        self.now = 0.0

    def say(self, frame: bytes, wait: float = PAUSE) -> bytes:
        reply = self.sim.receive(frame, self.now)
        assert reply is not None, frame.hex(" ")
        self.now += wait
        return reply

    def replay(self, section: str) -> None:
        for sent, reply in logged(section):
            assert self.say(sent).hex(" ") == reply.hex(" ")

    @property
    def shaft(self) -> float:
        return self.sim.shaft(self.now)

    @property
    def rpm(self) -> float:
        return float(r.SPEED.decode(payload(self.say(read(1, r.SPEED).adu, 0.0))))


def desk(section: str) -> Desk:
    """The drive as it was when a section was logged."""
    machine = Machine(home_switch=-2.0, right_switch=20.0, travel=(-5.0, 100_000.0))
    if section in ("9.4.3", "9.4.4"):
        machine.following_error = {"9.4.3": -1, "9.4.4": 1}[section]  # the coordinates logged differ by one
    model = Model.SERVO57D if section.startswith("6") else Model.SERVO42D  # 6.2 takes one for its IN_2
    on = Desk(SimMks(model=model, machine=machine, mode=WorkMode.CR_VFOC))
    if section in ("6.3", "6.4"):
        on.replay("6.2")
    if section == "9.3.3":
        # It stood at 1,801,985 - 163,840 counts, from what was done before.
        on.say(write(1, r.WORK_MODE, WorkMode.SR_VFOC).adu)
        on.say(write_block(1, r.MOVE_TO_COUNTS, 255, 3000, 1_801_985 - 163_840).adu)
    if section == "5.7":
        on.replay("5.4")
        on.say(write_block(1, r.MOVE_TO_COUNTS, 255, 3000, 7 * r.COUNTS_PER_TURN).adu)
    return on


@pytest.mark.parametrize("section", LOGGED)
def test_every_logged_request_gets_its_logged_reply(section: str) -> None:
    desk(section).replay(section)


def test_5_4_finds_the_switch_and_counts_from_there() -> None:
    on = desk("5.4")
    on.replay("5.4")
    assert on.shaft == pytest.approx(-2.0)
    assert on.sim.motion.homed == (Homed.NOT_DONE, Homed.DONE)
    assert on.sim.motion.counts(on.now) == 0


def test_5_4_says_that_it_is_homing_meanwhile() -> None:
    on = desk("5.4")
    for sent, _ in logged("5.4"):
        on.say(sent, 0.5)
    assert on.say(read(1, r.STATUS).adu)[4] == Status.HOMING
    assert on.sim.shaft(0.5 * 3 + 0.6) == pytest.approx(-1.0)  # 100 rpm: a turn in 0.6 s


def test_5_5_runs_against_the_stop_and_back_by_half_a_turn() -> None:
    on = desk("5.5")
    on.replay("5.5")
    assert on.shaft == pytest.approx(-5.0 + 0.5)
    assert on.sim.motion.counts(on.now) == 0
    assert not on.sim.motion.stalled


def test_5_6_turns_to_the_nearest_zero_of_the_turn_at_power_on() -> None:
    on = desk("5.6")
    on.replay("5.6")
    zero = on.shaft
    on.sim.switch_off(on.now)
    on.sim.turn_shaft(0.3, on.now)
    on.now += 5
    on.sim.switch_on(on.now)
    on.now += 5
    assert on.shaft == pytest.approx(zero)
    assert on.sim.motion.homed[0] is Homed.DONE


def test_5_7_goes_back_to_the_coordinate_zero() -> None:
    on = desk("5.7")
    assert on.shaft == pytest.approx(5.0)
    on.replay("5.7")
    assert on.shaft == pytest.approx(-2.0)


@pytest.mark.parametrize(("section", "ends_at"), [("6.3", -2.0), ("6.4", 20.0)])
def test_6_3_and_6_4_a_limit_switch_ends_a_move_towards_it(section: str, ends_at: float) -> None:
    on = desk(section)
    on.replay(section)
    assert on.shaft == pytest.approx(ends_at)
    # Away from it, it goes on.
    away = MotionDirection.CCW if section == "6.3" else MotionDirection.CW
    on.say(write_block(1, r.MOVE_PULSES, away, 240, 300, 3200).adu)
    assert abs(on.shaft - ends_at) == pytest.approx(1.0)


def test_8_4_turns_at_300_rpm_and_stops_with_its_ramp() -> None:
    on = desk("8.4")
    (mode, _), (run, _), (stop, _) = logged("8.4")
    on.say(mode)
    on.say(run)
    assert on.rpm == 300
    on.say(stop, 1.0)
    assert 0 < on.rpm < 300  # 300 rpm at 78.7 rpm/s take 3.8 s
    on.now += 3
    assert on.rpm == 0


def test_8_5_runs_by_itself_at_power_on_until_that_is_cleared() -> None:
    on = desk("8.5")
    on.replay("8.5")
    assert on.rpm == 0  # after saving, the motor slows down and stops
    on.sim.restart(on.now)
    on.now += 10
    assert on.rpm == 300
    on.say(bytes.fromhex("01 06 00 FF 00 CA 39 AD"))
    on.sim.restart(on.now)
    on.now += 10
    assert on.rpm == 0


def test_9_1_3_goes_100_turns_counter_clockwise() -> None:
    on = desk("9.1.3")
    on.replay("9.1.3")
    assert on.shaft == pytest.approx(100.0)


def test_9_2_3_goes_to_320000_pulses_from_zero() -> None:
    on = desk("9.2.3")
    on.replay("9.2.3")
    assert on.shaft == pytest.approx(100.0)


def test_9_3_3_goes_ten_turns_on() -> None:
    on = desk("9.3.3")
    before = on.shaft
    on.replay("9.3.3")
    assert on.shaft - before == pytest.approx(10.0)


def test_9_4_3_goes_to_ten_turns() -> None:
    on = desk("9.4.3")
    on.replay("9.4.3")
    assert on.shaft == pytest.approx(10.0)


def test_9_4_4_changes_target_and_speed_of_a_running_move() -> None:
    on = desk("9.4.4")
    (mode, _), (zero, _), (far, _), (back, _), (position, reply) = logged("9.4.4")
    on.say(mode)
    on.say(zero)
    on.say(far, 20.0)
    assert on.rpm == 300
    on.say(back, 12.0)
    assert on.rpm < -300  # turned round, and faster than before
    on.now += 20
    assert on.say(position) == reply
