"""The routines of chapter 3: the printed frames on the virtual drive, and the facade, which says the same."""

import pytest

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.values import ControlMode, Fault, ShaftState, Side
from rs485bus.sim import SimZlac
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant
from tests.devices.zlac.test_frames import FRAMES

TURNS_5 = 5.0


class Master:
    """Says printed frames to a drive, in time, and checks that it answers the printed answers."""

    def __init__(self) -> None:
        self.sim = SimZlac(1, watchdog=0)
        self.now = 0.0
        self._answers = {
            frame["hex"]: [other["hex"] for other in FRAMES if other["pair"] == frame["pair"]][1]
            for frame in FRAMES
            if frame["direction"] == "request"
        }

    def say(self, *frames: str) -> None:
        for frame in frames:
            self.now += 0.01
            reply = self.sim.receive(bytes.fromhex(frame), self.now)
            assert reply is not None
            assert reply.hex(" ").upper() == self._answers[frame]

    def wait(self, seconds: float) -> None:
        self.now += seconds

    def shafts(self) -> tuple[float, float]:
        return self.sim.shafts(self.now)

    def rpm(self) -> tuple[float, float]:
        left, right = self.sim.rpm(self.now)
        return round(left), round(right)


STOP = "01 06 20 0E 00 07 A2 0B"
ENABLE = "01 06 20 0E 00 08 E2 0F"
RAMPS = [
    "01 06 20 80 01 F4 83 F5",
    "01 06 20 81 01 F4 D2 35",
    "01 06 20 82 01 F4 22 35",
    "01 06 20 83 01 F4 73 F5",
]
SPEEDS = ["01 06 20 8E 00 32 63 F4", "01 06 20 8F 00 32 32 34"]
VELOCITY = ["01 06 20 0D 00 03 53 C8", *RAMPS, ENABLE]
ASYNCHRONOUS = ["01 06 20 0F 00 00 B2 09", "01 06 20 0D 00 01 D2 09", *RAMPS, *SPEEDS, ENABLE]
SYNCHRONOUS = ["01 06 20 0F 00 01 73 C9", "01 06 20 0D 00 01 D2 09", *RAMPS, *SPEEDS, ENABLE]
TORQUE = ["01 06 20 0D 00 04 12 0A", "01 06 20 86 01 F4 63 F4", "01 06 20 87 01 F4 32 34", ENABLE]


@pytest.mark.parametrize(
    ("ahead", "back", "turns"),
    [
        ("01 06 20 88 00 64 03 CB", "01 06 20 88 FF 9C 43 B9", (1, 0)),
        ("01 06 20 89 00 64 52 0B", "01 06 20 89 FF 9C 12 79", (0, 1)),
        ("01 10 20 88 00 02 04 00 64 00 64 23 9C", "01 10 20 88 00 02 04 FF 9C FF 9C D2 0B", (1, 1)),
    ],
    ids=["left", "right", "both"],
)
def test_3_1_the_printed_velocity_routine_turns_the_wheels_it_names(
    ahead: str, back: str, turns: tuple[int, int]
) -> None:
    master = Master()
    master.say(*VELOCITY, ahead)
    master.wait(0.25)
    assert master.rpm() == (50 * turns[0], 50 * turns[1])
    master.wait(0.25)
    assert master.rpm() == (100 * turns[0], 100 * turns[1])
    master.say(back)
    master.wait(0.5)
    assert master.rpm() == (-100 * turns[0], -100 * turns[1])
    master.say(STOP)
    assert {wheel.state for wheel in master.sim.wheels} == {ShaftState.RELEASED}
    master.wait(1.0)
    assert master.rpm() == (0, 0)


@pytest.mark.parametrize(
    ("setup", "ahead", "back", "start", "turns"),
    [
        (
            ASYNCHRONOUS,
            "01 10 20 8A 00 02 04 00 00 50 00 DE 71",
            "01 10 20 8A 00 02 04 FF FF B0 00 97 95",
            "01 06 20 0E 00 11 23 C5",
            (1, 0),
        ),
        (
            ASYNCHRONOUS,
            "01 10 20 8C 00 02 04 00 00 50 00 5E 5B",
            "01 10 20 8C 00 02 04 FF FF B0 00 17 BF",
            "01 06 20 0E 00 12 63 C4",
            (0, 1),
        ),
        (
            SYNCHRONOUS,
            "01 10 20 8A 00 04 08 00 00 50 00 00 00 50 00 E3 2C",
            "01 10 20 8A 00 04 08 FF FF B0 00 FF FF B0 00 FC A3",
            "01 06 20 0E 00 10 E2 05",
            (1, 1),
        ),
    ],
    ids=["left", "right", "both"],
)
def test_3_2_the_printed_position_routine_goes_five_turns_and_back(
    setup: list[str], ahead: str, back: str, start: str, turns: tuple[int, int]
) -> None:
    master = Master()
    master.say(*setup, ahead, start)
    master.wait(6.0)
    assert master.rpm() == (50 * turns[0], 50 * turns[1])
    master.wait(1.0)
    assert master.shafts() == pytest.approx((TURNS_5 * turns[0], TURNS_5 * turns[1]))
    master.say(back, start)
    master.wait(7.0)
    assert master.shafts() == pytest.approx((0, 0))
    assert master.sim.moves == (2 * turns[0], 2 * turns[1])
    master.say(STOP)


@pytest.mark.parametrize(
    ("ahead", "back", "turns"),
    [
        ("01 06 20 90 07 D0 81 8B", "01 06 20 90 F8 30 C1 F3", (1, 0)),
        ("01 06 20 91 07 D0 D0 4B", "01 06 20 91 F8 30 90 33", (0, 1)),
        ("01 10 20 90 00 02 04 07 D0 07 D0 60 23", "01 10 20 90 00 02 04 F8 30 F8 30 11 B9", (1, 1)),
    ],
    ids=["left", "right", "both"],
)
def test_3_3_the_printed_torque_routine_pushes_the_wheels_it_names(
    ahead: str, back: str, turns: tuple[int, int]
) -> None:
    master = Master()
    master.say(*TORQUE, ahead)
    master.wait(5.0)
    assert [wheel.torque(master.now) for wheel in master.sim.wheels] == [2000 * turns[0], 2000 * turns[1]]
    assert master.rpm() == (100 * turns[0], 100 * turns[1])
    master.say(back)
    master.wait(10.0)
    assert master.rpm() == (-100 * turns[0], -100 * turns[1])
    master.say(STOP)


def test_3_4_the_printed_emergency_stop_stops_both_wheels() -> None:
    master = Master()
    master.say(*VELOCITY, "01 10 20 88 00 02 04 00 64 00 64 23 9C")
    master.wait(1.0)
    master.say("01 06 20 0E 00 05 23 CA")
    master.wait(0.02)
    assert master.rpm() == (0, 0)
    assert {wheel.state for wheel in master.sim.wheels} == {ShaftState.EMERGENCY_STOP}


def test_3_5_the_printed_clearing_clears_the_faults() -> None:
    master = Master()
    master.say(*VELOCITY)
    master.sim.fail(Side.RIGHT, Fault.OVER_LOAD, master.now)
    master.say("01 06 20 0E 00 06 63 CB")
    assert not any(wheel.faults for wheel in master.sim.wheels)


def test_3_6_the_printed_frame_closes_the_left_brake() -> None:
    master = Master()
    master.say("01 06 20 1A 00 01 62 0D", *VELOCITY, "01 10 20 88 00 02 04 00 64 00 64 23 9C")
    master.wait(1.0)
    assert master.rpm() == (0, 100)
    assert master.sim.left.faults is Fault.OVER_LOAD


def body(frame: str) -> str:
    """Function and data of a printed frame."""
    return frame.replace(" ", "")[2:-4]


@on_virtual_clock
async def test_the_facade_says_the_velocity_routine() -> None:
    async with plant(acceleration=100) as p:
        begun = len(p.sim.asked)
        await p.base.run(100, 100)
        await p.base.run(-100, -100)
        assert p.sim.writes(begun) == [
            "1020800004" + "08" + "03E8" * 4,
            body("01 10 20 88 00 02 04 00 64 00 64 23 9C"),
            "1020800004" + "08" + "07D0" * 4,  # the change of speed is twice as great
            body("01 10 20 88 00 02 04 FF 9C FF 9C D2 0B"),
        ]
        await p.base.left.run(100)
        assert p.sim.writes()[-1] == body("01 06 20 88 00 64 03 CB")
        await p.base.right.run(100)
        assert p.sim.writes()[-1] == body("01 06 20 89 00 64 52 0B")


@pytest.mark.parametrize("who", ["left", "right", "pair"])
@on_virtual_clock
async def test_the_facade_says_the_position_routine_in_its_order(who: str) -> None:
    async with plant(WatchedZlac(counts=(r.MAX_ABSOLUTE, r.MAX_ABSOLUTE)), acceleration=100, rpm=50) as p:
        begun = len(p.sim.asked)
        if who == "pair":
            await p.base.move_by(TURNS_5, TURNS_5)
        else:
            await getattr(p.base, who).move_by(TURNS_5)
        expected = {
            "left": ["01 10 20 8A 00 02 04 00 00 50 00 DE 71", "01 06 20 0E 00 11 23 C5"],
            "right": ["01 10 20 8C 00 02 04 00 00 50 00 5E 5B", "01 06 20 0E 00 12 63 C4"],
            "pair": ["01 10 20 8A 00 04 08 00 00 50 00 00 00 50 00 E3 2C", "01 06 20 0E 00 10 E2 05"],
        }[who]
        writes = p.sim.writes(begun)
        assert writes[-2:] == [body(frame) for frame in expected]
        # Mode and enable come before; the way of starting only where it is another one; ramps that are held do not.
        order = [body("01 06 20 0D 00 01 D2 09"), body(ENABLE)]
        assert [write for write in writes if write in order] == order
        assert (body("01 06 20 0F 00 01 73 C9") in writes) == (who == "pair")
        assert p.sim.mode is ControlMode.POSITION_RELATIVE


@on_virtual_clock
async def test_the_facade_says_the_torque_routine() -> None:
    async with plant() as p:
        begun = len(p.sim.asked)
        await p.base.torque(2000, 2000, slope=500)
        writes = p.sim.writes(begun)
        order = [body("01 06 20 0D 00 04 12 0A"), body(ENABLE), body("01 10 20 90 00 02 04 07 D0 07 D0 60 23")]
        assert [write for write in writes if write in order] == order
        assert writes[-2] == body("01 10 20 86 00 02 04 01 F4 01 F4 00 00")
        await p.base.left.torque(-2000)
        assert p.sim.writes()[-1] == body("01 06 20 90 F8 30 C1 F3")
