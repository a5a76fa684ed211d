"""What the virtual drive does beyond the manual's examples: models, loads, limits, power."""

from typing import Any

import pytest

from rs485bus.bus.schedule.job import Outcome
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import current, native, read, write, write_block
from rs485bus.devices.mks.values import (
    BaudRate,
    Boot,
    GoHome,
    Homed,
    HomingMode,
    Inputs,
    Level,
    Model,
    MotionDirection,
    OutputMask,
    ParameterDirection,
    PowerOnRun,
    SingleTurn,
    Status,
    WorkMode,
    ZeroPoint,
)
from rs485bus.sim import Machine, SimMks
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import Request, crc, payload
from rs485bus.wire.registers import Block, Register

TURN = r.COUNTS_PER_TURN


class Hand:
    """Asks one drive, at times."""

    def __init__(self, **options: object) -> None:
        self.sim = SimMks(**options)  # type: ignore[arg-type] # each test names its own
        self.now = 1.0

    def ask(self, request: Request) -> bytes | None:
        self.now += 0.01
        return self.sim.receive(request.adu, self.now)

    def do(self, request: Request) -> None:
        reply = self.ask(request)
        assert reply is not None
        assert reply[:-2] == request.prefix, "refused"

    def refuses(self, request: Request) -> bool:
        reply = self.ask(request)
        return reply is not None and reply[:-2] == request.refusal

    def read(self, what: Register[Any] | Block) -> object:
        reply = self.ask(read(self.sim.address, what))
        assert reply is not None
        return what.decode(payload(reply))

    @property
    def inputs(self) -> Inputs:
        inputs = self.read(r.INPUTS)
        assert isinstance(inputs, Inputs)
        return inputs

    def go_to(self, counts: int, speed: int = 600) -> None:
        self.do(write_block(1, r.MOVE_TO_COUNTS, 0, speed, counts))

    def wait(self, seconds: float) -> None:
        self.now += seconds
        self.sim.advance(self.now)

    @property
    def shaft(self) -> float:
        return self.sim.shaft(self.now)


# Models


@pytest.mark.parametrize("model", [Model.SERVO28D, Model.SERVO35D, Model.SERVO42D])
def test_only_a_57d_has_outputs_and_takes_5200_milliamperes(model: Model) -> None:
    small, large = Hand(model=model), Hand(model=Model.SERVO57D)
    outputs = write_block(1, r.OUTPUTS, OutputMask.WRITE, True, OutputMask.LEAVE, False)
    divider = write_block(1, r.PULSE_DIVIDER, Level.LOW, 3200)
    strong = current(1, Model.SERVO57D, 5200, save=True)
    homing = write_block(1, r.HOMING_TORQUE, 0, HomingMode.STOP, 5200)
    for request in (outputs, divider, strong, homing):
        assert small.refuses(request)
        large.do(request)
    small.do(current(1, model, 3000, save=True))
    assert small.refuses(current(1, Model.SERVO57D, 3001, save=True))


def test_a_57d_shows_a_stall_on_out_1_and_pulses_on_out_2() -> None:
    hand = Hand(model=Model.SERVO57D, machine=Machine(home_switch=None))
    hand.do(write_block(1, r.PULSE_DIVIDER, Level.LOW, 3200))
    hand.do(write(1, r.STALL_PROTECTION, True))
    assert hand.inputs == Inputs.IN_1 | Inputs.IN_2 | Inputs.OUT_1
    hand.go_to(TURN)
    hand.wait(1)
    assert Inputs.OUT_2 in hand.inputs  # a turn is 3200 pulses: toggled once (4.3)
    hand.sim.put_load(5000, hand.now)
    hand.go_to(0)
    assert Inputs.OUT_1 not in hand.inputs


def test_outputs_are_written_as_their_masks_say() -> None:
    hand = Hand(model=Model.SERVO57D)
    hand.do(write_block(1, r.OUTPUTS, OutputMask.WRITE, True, OutputMask.WRITE, False))
    assert Inputs.OUT_2 in hand.inputs
    assert Inputs.OUT_1 not in hand.inputs
    hand.do(write_block(1, r.OUTPUTS, OutputMask.HOLD, False, OutputMask.LEAVE, True))
    assert Inputs.OUT_2 in hand.inputs
    assert Inputs.OUT_1 not in hand.inputs


# Limits


@pytest.mark.parametrize("model", [Model.SERVO42D, Model.SERVO57D])
@pytest.mark.parametrize("remapped", [False, True])
def test_only_a_57d_or_remapped_ports_have_a_right_limit(model: Model, remapped: bool) -> None:
    hand = Hand(model=model, machine=Machine(home_switch=-1, right_switch=1, remapped=remapped))
    hand.do(write(1, r.LIMIT_REMAP, remapped))
    hand.do(write_block(1, r.HOMING, Level.LOW, ParameterDirection.CW, 60, True))
    hand.go_to(3 * TURN)
    hand.wait(1)
    assert hand.shaft == pytest.approx(1 if model is Model.SERVO57D or remapped else 3)
    hand.go_to(-3 * TURN)
    hand.wait(1)
    assert hand.shaft == pytest.approx(-1)


def test_a_limit_is_met_by_a_shaft_that_would_have_come_back_before_anybody_looked() -> None:
    hand = Hand(model=Model.SERVO57D, machine=Machine(home_switch=-1, right_switch=1, start_delay=0.0))
    hand.do(write_block(1, r.HOMING, Level.LOW, ParameterDirection.CW, 60, True))
    hand.do(write_block(1, r.MOVE_TO_COUNTS, 236, 600, 10 * TURN))  # 1000 rpm/s
    hand.wait(0.29)
    hand.do(write_block(1, r.MOVE_TO_COUNTS, 236, 600, 0))  # it can stop at a turn and a half only
    hand.wait(3)
    assert hand.shaft == pytest.approx(1)


def test_a_switch_wired_to_the_other_port_is_not_seen() -> None:
    hand = Hand(machine=Machine(home_switch=-1, remapped=True))
    hand.do(write(1, r.GO_HOME, GoHome.ORIGIN))
    hand.wait(5)
    assert hand.shaft < -4
    assert hand.read(r.STATUS) is Status.HOMING


def test_homing_starts_off_a_switch_that_is_closed_already() -> None:
    hand = Hand(shaft=-1.5, machine=Machine(home_switch=-1))
    hand.do(write(1, r.GO_HOME, GoHome.ORIGIN))
    hand.wait(3)
    assert hand.shaft == pytest.approx(-1)
    assert hand.sim.motion.homed[1] is Homed.DONE


# Stops and loads


def test_a_mechanical_stop_blocks_the_shaft_and_is_noticed() -> None:
    hand = Hand(machine=Machine(home_switch=None, travel=(-2.0, 2.0)))
    hand.go_to(5 * TURN)
    hand.wait(2)
    assert hand.shaft == pytest.approx(2)
    assert hand.read(r.STALLED) is True
    assert hand.read(r.STATUS) is Status.FULL_SPEED  # unprotected, it goes on pushing


def test_a_load_stalls_a_motor_that_has_less_current() -> None:
    hand = Hand(machine=Machine(load=1500))
    hand.go_to(TURN)
    hand.wait(1)
    assert hand.shaft == pytest.approx(1)
    hand.do(current(1, Model.SERVO42D, 1400, save=False))
    hand.go_to(0)
    hand.wait(1)
    assert hand.shaft == pytest.approx(1)
    assert hand.read(r.STALLED) is True


@pytest.mark.parametrize("protected", [False, True])
def test_a_load_in_the_middle_of_a_move_stalls_it_and_it_goes_on_only_unprotected(protected: bool) -> None:
    hand = Hand()
    hand.do(write(1, r.STALL_PROTECTION, protected))
    hand.go_to(10 * TURN)
    hand.wait(0.5)
    hand.sim.put_load(5000, hand.now)
    stands = hand.shaft
    assert 0 < stands < 10
    hand.wait(1)
    assert hand.shaft == stands
    assert hand.read(r.ENABLED) is not protected
    hand.sim.put_load(0, hand.now)
    hand.wait(2)
    assert hand.shaft == pytest.approx(stands if protected else 10)


def test_a_protected_stall_is_released_by_command_and_then_moves_again() -> None:
    hand = Hand(machine=Machine(load=5000))
    hand.do(write(1, r.STALL_PROTECTION, True))
    hand.go_to(TURN)
    assert hand.refuses(write_block(1, r.MOVE_TO_COUNTS, 0, 600, TURN))
    assert hand.refuses(write(1, r.ENABLE, True))
    hand.do(write(1, r.RELEASE_STALL, 1))
    assert hand.read(r.STALLED) is False
    hand.sim.put_load(0, hand.now)
    hand.go_to(TURN)
    hand.wait(1)
    assert hand.shaft == pytest.approx(1)


def test_position_protection_lets_go_after_its_time() -> None:
    hand = Hand(machine=Machine(load=5000))
    hand.do(write_block(1, r.POSITION_PROTECTION, 0, True, 0.75, 0.1))
    hand.go_to(TURN)
    hand.wait(0.7)
    assert hand.read(r.ENABLED) is True
    hand.wait(0.1)
    assert hand.read(r.ENABLED) is False


def test_homing_with_too_little_current_takes_the_load_for_the_stop() -> None:
    hand = Hand(machine=Machine(home_switch=None, travel=(-5.0, 5.0), load=500))
    hand.do(write_block(1, r.HOMING_TORQUE, 0, HomingMode.STOP, 400))
    hand.do(write(1, r.GO_HOME, GoHome.ORIGIN))
    hand.wait(20)
    assert hand.shaft == pytest.approx(0)
    hand.do(write_block(1, r.HOMING_TORQUE, 0, HomingMode.STOP, 600))
    hand.do(write(1, r.GO_HOME, GoHome.ORIGIN))
    hand.wait(20)
    assert hand.shaft == pytest.approx(-5)


# Homing to the zero of the turn


@pytest.mark.parametrize(
    ("mode", "direction", "ends_at"),
    [
        (SingleTurn.NEAREST, ParameterDirection.CW, 1.0),
        (SingleTurn.BY_DIRECTION, ParameterDirection.CW, 0.0),
        (SingleTurn.BY_DIRECTION, ParameterDirection.CCW, 1.0),
    ],
)
def test_single_turn_homing_goes_its_way(mode: SingleTurn, direction: ParameterDirection, ends_at: float) -> None:
    hand = Hand()
    hand.do(write_block(1, r.HOMING_TORQUE, 0x2000, HomingMode.SINGLE_TURN, 400))
    hand.do(write_block(1, r.SINGLE_TURN, mode, ZeroPoint.SET_HERE, 4, direction))
    hand.go_to(round(0.7 * TURN))
    hand.wait(1)
    hand.do(write(1, r.GO_HOME, GoHome.ORIGIN))
    assert hand.read(r.HOMED) == (Homed.UNDER_WAY, Homed.NOT_DONE)
    hand.wait(1)
    assert hand.read(r.HOMED) == (Homed.DONE, Homed.NOT_DONE)
    assert hand.shaft == pytest.approx(ends_at)


def test_a_cleared_zero_of_the_turn_is_not_gone_to() -> None:
    hand = Hand()
    hand.do(write_block(1, r.HOMING_TORQUE, 0x2000, HomingMode.SINGLE_TURN, 400))
    hand.do(write_block(1, r.SINGLE_TURN, SingleTurn.NEAREST, ZeroPoint.SET_HERE, 4, ParameterDirection.CW))
    hand.do(write_block(1, r.SINGLE_TURN, SingleTurn.NEAREST, ZeroPoint.CLEAR, 4, ParameterDirection.CW))
    hand.go_to(TURN // 3)
    hand.wait(1)
    hand.do(write(1, r.GO_HOME, GoHome.ORIGIN))
    hand.wait(1)
    assert hand.shaft == pytest.approx(1 / 3, abs=1e-3)


def test_the_slow_setting_is_answered_after_1_6_seconds_and_the_next_at_once() -> None:
    hand = Hand()
    hand.do(write_block(1, r.SINGLE_TURN, SingleTurn.NEAREST, ZeroPoint.KEEP, 2, ParameterDirection.CW))
    assert hand.sim.turnaround == 1.6
    hand.read(r.STATUS)
    assert hand.sim.turnaround is None


# Power


def test_a_power_cycle_keeps_the_settings_and_counts_from_zero() -> None:
    hand = Hand()
    hand.do(write(1, r.MICROSTEPS, 64))
    hand.do(current(1, Model.SERVO42D, 2000, save=True))
    hand.do(current(1, Model.SERVO42D, 900, save=False))
    assert hand.sim.motion.current == 900
    hand.go_to(3 * TURN)
    hand.wait(2)
    hand.sim.switch_off(hand.now)
    assert hand.ask(read(1, r.STATUS)) is None
    hand.sim.turn_shaft(0.25, hand.now)
    hand.sim.switch_on(hand.now)
    assert hand.ask(read(1, r.STATUS)) is None
    hand.wait(0.7)
    assert hand.read(r.POSITION) == 0
    assert hand.shaft == pytest.approx(3.25)
    assert hand.sim.settings[r.MICROSTEPS.address] == 64
    assert hand.sim.motion.current == 2000
    assert hand.sim.restarts == 1


def test_a_factory_reset_forgets_the_settings_and_restarts() -> None:
    hand = Hand()
    hand.do(write(1, r.MICROSTEPS, 64))
    hand.do(write(1, r.FACTORY_RESET, 1))
    assert hand.ask(read(1, r.STATUS)) is None
    hand.wait(0.7)
    assert hand.sim.settings[r.MICROSTEPS.address] == 16
    assert hand.sim.settings[r.WORK_MODE.address] is WorkMode.CR_VFOC


def test_a_factory_reset_may_take_address_and_baud_rate_with_it() -> None:
    sim = SimMks(5, baudrate=115200, reset_keeps_line=False)
    sim.receive(write(5, r.FACTORY_RESET, 1).adu, 1.0)
    assert (sim.address, sim.baudrate) == (1, 38400)


def test_a_calibration_shows_in_the_status_and_ends_in_a_restart() -> None:
    hand = Hand()
    hand.do(write(1, r.CALIBRATE, 1))
    assert hand.read(r.STATUS) is Status.CALIBRATING
    assert hand.refuses(write_block(1, r.MOVE_TO_COUNTS, 0, 600, TURN))
    hand.wait(3)
    assert hand.ask(read(1, r.STATUS)) is None
    hand.wait(1)
    assert hand.read(r.STATUS) is Status.STOPPED


def test_a_silent_drive_answers_nothing_but_the_command_that_wakes_it() -> None:
    hand = Hand()
    hand.do(write(1, r.BOOT, Boot.ENTER_SILENCE))
    assert hand.ask(read(1, r.STATUS)) is None
    assert hand.ask(write_block(1, r.MOVE_TO_COUNTS, 0, 600, TURN)) is None
    hand.wait(1)
    assert hand.shaft == 0
    hand.do(write(1, r.BOOT, Boot.LEAVE_SILENCE))
    assert hand.read(r.STATUS) is Status.STOPPED


def test_boot_mode_lasts_until_it_is_switched_off_and_on() -> None:
    hand = Hand()
    hand.do(write(1, r.BOOT, Boot.ENTER_BOOT))
    hand.wait(100)
    assert hand.ask(write(1, r.BOOT, Boot.LEAVE_SILENCE)) is None
    hand.sim.restart(hand.now)
    hand.wait(1)
    assert hand.read(r.STATUS) is Status.STOPPED


def test_a_saved_run_is_refused_after_a_change_to_a_pulse_mode() -> None:
    hand = Hand()
    hand.do(write_block(1, r.RUN, MotionDirection.CW, 0, 60))
    hand.do(write(1, r.POWER_ON_RUN, PowerOnRun.SAVE))
    hand.wait(1)
    hand.sim.restart(hand.now)
    hand.wait(1.6)
    assert hand.shaft < -0.5


# The line


@pytest.mark.parametrize("at_new", [False, True])
def test_a_new_address_is_answered_at_the_old_or_at_the_new_one(at_new: bool) -> None:
    hand = Hand(answers_at_new=at_new)
    reply = hand.ask(write(1, r.ADDRESS, 9))
    assert reply is not None
    assert reply[0] == (9 if at_new else 1)
    assert crc(reply[:-2]) == reply[-2:]
    hand.wait(0.1)
    assert hand.ask(read(1, r.STATUS)) is None
    assert hand.ask(read(9, r.STATUS)) is not None


@pytest.mark.parametrize("at_new", [False, True])
def test_modbus_is_switched_off_by_modbus_and_on_by_the_native_frame(at_new: bool) -> None:
    hand = Hand(answers_at_new=at_new)
    off = hand.ask(write(1, r.MODBUS, False))
    assert off == (bytes.fromhex("FB 01 8E 01 8B") if at_new else write(1, r.MODBUS, False).adu)
    assert hand.ask(read(1, r.STATUS)) is None
    assert hand.ask(native(2, r.MODBUS.address, 1)) is None
    assert hand.ask(read(1, r.STATUS)) is None
    hand.ask(native(1, r.MODBUS.address, 1))
    assert hand.read(r.STATUS) is Status.STOPPED


def test_the_native_frame_means_nothing_to_a_drive_that_speaks_modbus() -> None:
    assert Hand().ask(native(1, r.MODBUS.address, 1)) is None


def test_the_codes_of_baud_rates_change_the_rate() -> None:
    hand = Hand(baudrate=38400)
    hand.do(write(1, r.BAUD_RATE, BaudRate.BAUD_256000))
    hand.wait(0.1)
    assert hand.sim.baudrate == 256000


def test_a_reply_at_another_baud_rate_is_noise() -> None:
    for at_new, outcome in ((True, Outcome.NO_REPLY), (False, Outcome.REPLY)):
        rig = Rig(SimMks(baudrate=115200, answers_at_new=at_new))
        rig.done(rig.submit(read(1, r.STATUS)))
        job = rig.submit(write(1, r.BAUD_RATE, BaudRate.BAUD_9600), retries=0)
        rig.done(job)
        assert job.outcome is outcome
        rig.run(0.1)
        after = rig.submit(read(1, r.STATUS), retries=0)
        rig.run(1.0)
        assert after.outcome is Outcome.NO_REPLY


def test_other_functions_and_windows_get_no_answer() -> None:
    sim = SimMks()
    for pdu in ("03 00 31 00 03", "04 00 30 00 06", "05 00 82 FF 00", "2B 0E 01 00"):
        body = b"\x01" + bytes.fromhex(pdu)
        assert sim.receive(body + crc(body), 1.0) is None


def test_values_out_of_range_and_unknown_registers_are_refused() -> None:
    sim = SimMks()
    for pdu, refusal in (
        ("06 00 82 00 06", "06 00 82 FF FF"),
        ("06 00 77 00 01", "06 00 77 FF FF"),
        ("10 00 F5 00 04 08 00 02 0B B9 00 00 00 00", "10 00 F5 00 00"),
        ("10 00 F5 00 02 04 00 02 0B B8", "10 00 F5 00 00"),
    ):
        body = b"\x01" + bytes.fromhex(pdu)
        reply = sim.receive(body + crc(body), 1.0)
        assert reply is not None
        assert reply[1:-2] == bytes.fromhex(refusal)
    assert sim.moves == 0
