"""What a user gives that cannot be meant is refused where it is given, and the message says what is allowed."""

import math
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import pytest

from rs485bus import BusConfig, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.arguments import flag, pair, positive, real, whole
from rs485bus.bus.bus import Bus
from rs485bus.devices.axis import Axis
from rs485bus.devices.mks import Model, WorkMode
from rs485bus.devices.tlr import Homing, HomingMode
from rs485bus.sim import SimMks, SimTlr, SimUnit, SimZlac, VirtualLine
from tests.integration.support import virtual

FAMILIES: list[tuple[Callable[..., Any], int]] = [(MksServo, 1), (Zlac8015d, 2), (TlrStepper, 3)]


def line() -> VirtualLine:
    return VirtualLine(SimMks(1), SimZlac(2), SimTlr(3), SimUnit(7, dict.fromkeys(range(10), 0)))


class Count:
    """A whole number of another library's: numpy's behave so."""

    def __init__(self, value: int) -> None:
        self.value = value

    def __index__(self) -> int:
        return self.value


class Measure:
    """A number of another library's."""

    def __init__(self, value: float) -> None:
        self.value = value

    def __float__(self) -> float:
        return self.value


# The rules


def test_numbers_of_other_libraries_become_plain_ones() -> None:
    assert type(whole("count", Count(3), 1)) is int
    assert [real("rpm", value) for value in (3, Count(3), Measure(3.0), Fraction(3), Decimal(3))] == [3.0] * 5
    assert all(type(real("rpm", value)) is float for value in (3, Count(3), Measure(3.0)))


class Truth:
    """True or False of another library's: numpy's behaves so."""

    dtype = "bool"

    def __float__(self) -> float:
        return 1.0

    def __index__(self) -> int:
        return 1


@pytest.mark.parametrize("value", ["5", b"5", None, True, Truth(), [5], 1j])
def test_what_is_no_number_is_a_type_error_that_shows_it(value: Any) -> None:
    for check in (lambda: real("rpm", value), lambda: positive("rpm", value), lambda: whole("rpm", value, 1, 5)):
        with pytest.raises(TypeError, match=r"rpm must be a .*number.*, not "):
            check()


def test_a_flag_takes_0_and_1_and_no_text() -> None:
    assert (flag("reverse", True), flag("reverse", 0)) == (True, False)  # type: ignore[arg-type] # it will do
    for value in ("no", "", None, 2, (True, False)):
        with pytest.raises(TypeError, match="reverse must be True or False, not"):
            flag("reverse", value)  # type: ignore[arg-type] # the point of the test


def test_two_letters_are_no_pair() -> None:
    for value in ("no", 5, (1,), (1, 2, 3), None):
        with pytest.raises(TypeError, match="must be two, not"):
            pair("limits", value, "two")  # type: ignore[arg-type] # the point of the test


# What the rules are applied to

CONSTRUCTED: list[tuple[dict[str, Any], str]] = [
    ({"address": "1"}, r"address must be a whole number in 1\.\.\d+, not '1'"),
    ({"address": True}, "address must be a whole number .*, not True"),
    ({"address": 1.5}, "address must be a whole number .*, not 1.5"),
    ({"limits": 5}, r"limits must be a pair of numbers: \(lowest, highest\), not 5"),
    ({"limits": (1,)}, r"limits must be a pair of numbers: .*, not \(1,\)"),
    ({"limits": (math.nan, 1)}, "limits must be a number, not nan"),
    ({"reverse": "no"}, "reverse must be .*, not 'no'"),
    ({"units_per_turn": math.inf}, "units_per_turn must be a finite number above 0, not inf"),
    ({"units_per_turn": math.nan}, "units_per_turn must be a finite number above 0, not nan"),
    ({"units_per_turn": -8}, "above 0, not -8; use reverse=True"),
    ({"tolerance": -1}, "tolerance -1 is below 0"),
    ({"rpm": 0}, "rpm 0 is outside its range, which is above 0, up to [13]000 "),
    ({"rpm": 3001}, "rpm 3001 is outside its range, which is above 0, up to [13]000 "),
    ({"rpm": "90"}, "rpm must be a number, not '90'"),
    ({"acceleration": "fast"}, "acceleration must be a number, not 'fast'"),
]
OF_ONE_FAMILY: list[tuple[Callable[[Bus], object], str]] = [
    (lambda bus: MksServo(bus, 1, mode=9), r"mode 9 is none of CR_OPEN \(0\), .*SR_VFOC \(5\) of WorkMode"),  # type: ignore[arg-type]
    (lambda bus: MksServo(bus, 1, model="43D"), "model '43D' is none of SERVO28D .* of Model"),  # type: ignore[arg-type]
    (lambda bus: MksServo(bus, 1, microsteps="16"), r"microsteps must be a number in 1\.\.255, not '16'"),  # type: ignore[arg-type]
    (lambda bus: Zlac8015d(bus, 2, encoder_lines=-3), "encoder_lines -3 is below 1"),
    (lambda bus: Zlac8015d(bus, 2, max_rpm=-1), "max_rpm must be a finite number above 0, not -1"),
    (lambda bus: Zlac8015d(bus, 2, max_rpm=math.nan), "max_rpm must be a finite number above 0, not nan"),
    (lambda bus: Zlac8015d(bus, 2, max_rpm=50, rpm=60), r"rpm 60 .* up to 50 \(the least of max_rpm"),
    (lambda bus: Zlac8015d(bus, 2, status_word_left="left"), "neither 'low' nor 'high'"),  # type: ignore[arg-type]
    (lambda bus: TlrStepper(bus, 3, pulses_per_turn=0), "pulses_per_turn 0 is below 1"),
    (lambda bus: TlrStepper(bus, 3, ramp_rpm=-1), "ramp_rpm must be a finite number above 0"),
    (lambda bus: TlrStepper(bus, 3, clear_trigger="no"), "clear_trigger must be True or False"),  # type: ignore[arg-type]
    (lambda bus: MksServo(bus, 1).home("switch"), r"homing must be made like SwitchHoming\(\), .*, not 'switch'"),  # type: ignore[arg-type]
    (lambda bus: MksServo(bus, 1).set_homing("switch"), "homing must be made like SwitchHoming"),  # type: ignore[arg-type]
    (lambda bus: TlrStepper(bus, 3).home("switch"), r"homing must be made like Homing\(mode=HomingMode"),  # type: ignore[arg-type]
    (lambda bus: MksServo(bus, 1).set_heartbeat("1"), "heartbeat time must be a number, not '1'"),  # type: ignore[arg-type]
    (lambda bus: MksServo(bus, 1).move_by_pulses("5"), "pulses must be a number, not '5'"),  # type: ignore[arg-type]
    (lambda bus: MksServo(bus, 1).move_by_pulses(1.5), "pulses 1.5 is not a whole number"),  # type: ignore[arg-type]
    (lambda bus: bus.unit("3"), r"address must be a whole number in 1\.\.247, not '3'"),  # type: ignore[arg-type]
    (lambda bus: bus.unit(True), "address must be a whole number"),
    (lambda bus: bus.unit([]), "address must be a whole number"),  # type: ignore[arg-type]
]
VERBS: list[tuple[Callable[[Axis], object], str]] = [
    (lambda axis: axis.move_to("5"), "position must be a number, not '5'"),  # type: ignore[arg-type]
    (lambda axis: axis.move_to(None), "position must be a number, not None"),  # type: ignore[arg-type]
    (lambda axis: axis.move_by("5"), "distance must be a number, not '5'"),  # type: ignore[arg-type]
    (lambda axis: axis.run("90"), "rpm must be a number, not '90'"),  # type: ignore[arg-type]
    (lambda axis: axis.run(90, duration="1"), "duration must be a number, not '1'"),  # type: ignore[arg-type]
    (lambda axis: axis.move_to(1, acceleration="fast"), "acceleration must be a number, not 'fast'"),  # type: ignore[arg-type]
    (lambda axis: axis.move_to(1, rpm=0), "rpm 0 is outside its range, which is above 0, up to "),
    (lambda axis: axis.move_to(1, rpm=-5), "rpm -5 is outside its range, which is above 0, up to "),
]
REQUESTS: list[tuple[str, tuple[Any, ...], dict[str, Any], str]] = [
    ("write_register", (0, "5"), {}, r"register value must be a whole number in 0\.\.65535, not '5'"),
    ("write_register", (0, 1.5), {}, "register value must be a whole number .*, not 1.5"),
    ("write_registers", (0, 5), {}, r"values must be a sequence of register values, \[1, 2\] say, not 5"),
    ("write_registers", (0, "12"), {}, "register value must be a whole number .*, not '1'"),
    ("read_holding_registers", ("0", 1), {}, r"register address must be a whole number in 0\.\.65535, not '0'"),
    ("read_holding_registers", (0, 1.5), {}, r"count must be a whole number in 1\.\.125, not 1.5"),
    ("read_input_registers", (0, True), {}, "count must be a whole number .*, not True"),
    ("read_input_registers", (0,), {"timeout": "1"}, "timeout must be a number, not '1'"),
    ("read_input_registers", (0,), {"timeout": math.nan}, "timeout must be a number, not nan"),
    ("read_input_registers", (0,), {"urgency": "stop"}, "urgency 'stop' is none of STOP"),
    ("write_register", (0, 1), {"repeat": "often"}, "repeat 'often' is none of SAFE"),
]


@pytest.mark.parametrize(("arguments", "said"), CONSTRUCTED)
@virtual
async def test_a_facade_of_any_family_is_not_made_of_what_it_cannot_be(arguments: dict[str, Any], said: str) -> None:
    async with open_bus(line()) as bus:
        for make, address in FAMILIES:
            with pytest.raises((TypeError, ValueError), match=said):
                make(bus, **{"address": address, **arguments})
            make(bus, address)  # the address was not taken
        assert bus.stats.transactions == 0


@pytest.mark.parametrize(("make", "said"), OF_ONE_FAMILY)
@virtual
async def test_what_only_one_family_has_is_checked_too(make: Callable[[Bus], object], said: str) -> None:
    async with open_bus(line()) as bus:
        with pytest.raises((TypeError, ValueError), match=said):
            make(bus)
        assert bus.stats.transactions == 0


@pytest.mark.parametrize(("verb", "said"), VERBS)
@virtual
async def test_a_verb_refuses_what_is_no_number_at_the_call(verb: Callable[[Axis], object], said: str) -> None:
    async with open_bus(line()) as bus:
        for axis in (MksServo(bus, 1), Zlac8015d(bus, 2).left, TlrStepper(bus, 3)):
            with pytest.raises((TypeError, ValueError), match=said):
                verb(axis)
        assert bus.stats.transactions == 0


@pytest.mark.parametrize(("method", "arguments", "options", "said"), REQUESTS)
@virtual
async def test_plain_modbus_takes_whole_numbers_that_fit(
    method: str, arguments: tuple[Any, ...], options: dict[str, Any], said: str
) -> None:
    async with open_bus(line()) as bus:
        with pytest.raises((TypeError, ValueError), match=said):
            await getattr(bus.unit(7), method)(*arguments, **options)
        assert bus.stats.transactions == 0


@virtual
async def test_a_unit_says_which_it_is() -> None:
    async with open_bus(line()) as bus:
        assert repr(bus.unit(3)) == "<unit 3>"


@virtual
async def test_numbers_of_other_libraries_do_wherever_numbers_do() -> None:
    async with open_bus(line()) as bus:
        unit: Any = bus.unit(Count(7))  # type: ignore[arg-type] # the point of the test
        assert unit is bus.unit(7)
        await unit.write_registers(Count(2), [Count(5), 6], timeout=Measure(1.0))
        assert await unit.read_holding_registers(Count(2), Count(2)) == [5, 6]
        make: Any = MksServo
        x = make(bus, Count(1), units_per_turn=Measure(2.0), limits=(Count(0), Measure(9.0)), tolerance=Count(8))
        await x.enable()
        assert await x.move_to(Measure(1.0), rpm=Count(600), acceleration=Measure(2000.0)) == 1.0
        await x.move_by_pulses(Count(160))
        await x.run(Count(60), duration=Measure(0.5))
        await x.home(timeout=Count(60))
        async with x.watchdog(Count(1)):
            pass


@virtual
async def test_the_value_of_a_choice_does_for_its_name() -> None:
    async with open_bus(line()) as bus:
        make: Any = MksServo
        x = make(bus, 1, mode=4, model="57D")
        assert (x.mode, x.model) == (WorkMode.SR_CLOSE, Model.SERVO57D)
        await x.set_mode(5)
        assert x.mode is WorkMode.SR_VFOC
        await x.enable()
        assert await x.move_by(0.5) == 0.5
        way: Any = 35
        assert Homing(mode=way).mode is HomingMode.HERE


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("/dev/ttyUSB0", {"baudrate": "38400"}), r"baudrate must be a whole number in 300\.\.4000000, not '38400'"),
        (("/dev/ttyUSB0", {"baudrate": 9600, "config": None}), r"config must be made like BusConfig\(.*\), not None"),
        (("/dev/ttyUSB0", {"baudrate": 9600, "config": {"retries": 1}}), "config must be made like BusConfig"),
        (("socket://host:4196", {"baudrate": 0}), "baudrate 0 is outside"),
        (("socket://host:99999", {}), "should look like socket://"),
        (("ftp://host:502", {}), r"'ftp://host:502' is no port; it must be a serial port .*'socket://host:4196'"),
        (("", {"baudrate": 9600}), "'' is no port; it must be a serial port"),
        ((5, {"baudrate": 9600}), "port must be a serial port .*, or a transport, not 5"),
    ],
)
def test_a_bus_is_not_opened_on_what_cannot_be_one(arguments: tuple[Any, dict[str, Any]], said: str) -> None:
    port, options = arguments
    with pytest.raises((TypeError, ValueError), match=said):
        open_bus(port, **options)


@pytest.mark.parametrize(
    "settings", [{"reply_timeout": "1"}, {"retries": 1.5}, {"retries": True}, {"leave_running": "no"}]
)
def test_a_setting_of_a_wrong_type(settings: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=f"{next(iter(settings))} must be "):
        BusConfig(**settings)
