"""Situations of `test_foreign.py` that the bus does not meet yet as it should."""

from __future__ import annotations

import pytest

from rs485bus.bus.schedule.job import Outcome, Urgency
from rs485bus.wire.frames import write_single
from rs485bus.wire.registers import Repeat
from tests.endings.cable import framed
from tests.endings.program import PLAIN, all_done, read, wait, work, write
from tests.endings.records import Setting
from tests.endings.slaves import Reaction
from tests.endings.world import World


@pytest.mark.parametrize("echo_config", ["auto", False])
@pytest.mark.parametrize(
    "habit",
    [
        Reaction("before", data=b"\0"),  # pyhys/minimalmodbus#61, libmodbus#14
        Reaction("before", data=b"\xff"),
        Reaction("after", data=b"\0"),
        Reaction("after", data=b"\0\0\0"),  # home-assistant/core#69742
        Reaction("after", data=b"\xff"),
    ],
    ids=lambda habit: f"{habit.kind} {habit.data.hex()}",
)
def test_a_pair_without_bias_puts_bytes_around_every_reply(habit: Reaction, echo_config: object) -> None:
    world = World(Setting(echo_config=echo_config))
    for slave in world.slaves.values():
        slave.habit = lambda frame: habit
    all_done(world, work(world))


def test_bytes_on_both_sides_of_every_reply() -> None:
    # eModbus/eModbus#40: 00 before and after
    world = World(Setting(echo_config="auto"))

    def habit(frame: bytes) -> Reaction:
        return Reaction("both", data=b"\0")

    for slave in world.slaves.values():
        slave.habit = habit
    all_done(world, work(world))


@pytest.mark.parametrize("latency", [0.0, 0.001, 0.016])
@pytest.mark.parametrize("echo", ["full", "split", "damaged"])
@pytest.mark.parametrize("echo_config", ["auto", True])
def test_an_adapter_that_returns_what_is_sent(echo: str, latency: float, echo_config: object) -> None:
    # epics-modules/modbus#39 (glued to the answer), rosswarren/epevermodbus#27 (a byte short), libmodbus#380
    world = World(Setting(echo=echo, echo_config=echo_config, latency=latency))
    all_done(world, work(world))


@pytest.mark.parametrize("echo", ["full", "split"])
def test_a_write_to_nobody_over_an_echoing_adapter_is_not_done(echo: str) -> None:
    world = World(Setting(echo=echo, echo_config="auto"))
    asked = [world.submit(write_single(20, 1, 5), repeat=Repeat.NEVER, moves=True) for _ in range(3)]
    world.run(world.now + 20)
    assert all(one.ends == 1 for one in asked)
    assert Outcome.REPLY not in {one.outcome for one in asked}
    assert world.finish() == []


def test_a_gateway_that_stalls_and_then_answers_everything() -> None:
    # pymodbus-dev/pymodbus#2636
    world = World(Setting(echo_config=False, gateway=True))
    until = world.now + 1.5
    world.slaves[10].habit = lambda frame: Reaction("late", max(0.0, until - world.now))
    asked = [read(world, register) for register in range(4)]
    for one in asked:
        wait(world, one, 30)
    assert world.finish() == []


def test_a_drive_whose_modbus_is_off_says_the_first_three_bytes() -> None:
    # makerbase-motor/MKS-SERVO42D-57D#13
    world = World(PLAIN)
    world.drives[1].habit = lambda frame: Reaction("instead", data=frame[:3])
    world.do_stop(1, True, False)
    world.do_move(1, 60, 0.0)
    world.run(world.now + 8)
    assert world.stops[0].told
    assert not world.stops[0].told[0][1]
    assert world.asked[0].outcome in (Outcome.NOT_SENT, Outcome.UNKNOWN)
    assert world.finish() == []


@pytest.mark.parametrize("by_silence", [True, False])
def test_a_stop_on_a_babbling_line_is_on_the_wire_within_25_ms_and_ends(by_silence: bool) -> None:
    world = World(Setting(echo_config=False, by_silence=by_silence))
    world.do_move(1, 60, 0.0)
    world.run(world.now + 0.1)
    world.do_babble(60.0, 0.001, 0.001)
    world.run(world.now + 0.05)
    asked = world.now
    others = [read(world), write(world, 1), read(world, expires_at=world.now + 0.3)]
    world.do_stop(1, True, False)
    world.run(world.now + 3.0)
    stops = [sent for sent in world.cable.sent if sent.frame[1:4] == b"\x06\x00\xf7" and sent.start > asked]
    assert stops
    assert stops[0].start - asked <= 0.025
    assert world.stops[0].told
    assert [one.ends for one in others] == [1, 1, 1]
    assert others[0].ended_at - asked <= 1.1
    assert others[1].ended_at - asked <= 1.1
    assert others[2].ended_at - asked <= 0.301


def test_a_stop_on_a_line_with_gaps_now_and_then_is_confirmed_within_a_second() -> None:
    for seed in range(20):
        world = World(Setting(echo_config=False, by_silence=True))
        world.rng.seed(seed)
        world.do_move(1, 60, 0.0)
        world.run(world.now + 0.1)
        begun = world.now

        def babble(now: float, world: World = world) -> None:
            world.cable.noise(b"\x55", now)
            gap = world.rng.uniform(0.003, 0.006) if world.rng.random() < 0.1 else world.rng.uniform(0.0005, 0.0016)
            world.cable.at(now + gap, babble)

        world.cable.at(world.now, babble)
        world.run(world.now + 0.05)
        asked = world.now
        world.do_stop(1, True, False)
        world.run(world.now + 1.0)
        assert begun < asked
        assert world.stops[0].told, seed
        assert world.stops[0].told[0][1], seed
        assert not world.drives[1].moves(world.now), seed


def test_a_read_waits_thirty_seconds_for_the_port_and_a_moving_write_not_at_all() -> None:
    world = World(PLAIN)
    world.do_unplug()
    one, changed, short = read(world), write(world, 2), read(world, expires_at=world.now + 0.5)
    begun = world.now
    world.run(world.now + 31)
    assert changed.ended_at == begun
    assert changed.outcome is Outcome.NOT_SENT
    assert short.ended_at - begun == pytest.approx(0.5, abs=0.01)
    assert one.ended_at - begun == pytest.approx(30, abs=0.5)


def test_what_waits_behind_a_stop_that_cannot_be_confirmed_ends_when_it_was_tried_three_times() -> None:
    world = World(PLAIN)
    world.drives[1].dead_until = world.now + 1000
    world.do_move(1, 60, 0.0)
    world.run(world.now + 0.5)
    world.do_stop(1, True, False)
    world.do_setting(1, 0x83, 1)
    world.do_broadcast(2, 1)
    other = read(world)
    world.run(world.now + 5)
    assert world.asked[1].ends == 1
    assert world.asked[2].ends == 1
    assert other.outcome is Outcome.REPLY
    world.drives[1].dead_until = 0.0
    world.run(world.now + 5)
    late = [done for done in world.drives[1].done if done.pdu[:3] == b"\x06\x00\x83"]
    assert not late


def test_a_stop_cuts_at_most_one_transaction_for_each_of_its_frames() -> None:
    """Stops to a dead drive, which owes replies, and a slow slave beside it whose writes must not become unknown."""
    world = World(PLAIN)
    world.slaves[10].turnaround = 0.025
    world.drives[1].dead_until = world.now + 1000
    stop = write_single(1, 0xF7, 1)
    world.submit(stop, urgency=Urgency.STOP, repeat=Repeat.SAFE)
    world.run(world.now + 0.2)
    before = len(world.cable.sent)
    pressed = world.submit(stop, urgency=Urgency.STOP, repeat=Repeat.SAFE)
    asked = []
    for _ in range(20):
        asked.append(write(world, 1))
        world.run(world.now + 0.04)
    frames = sum(sent.frame[0] == 1 for sent in world.cable.sent[before:])
    assert pressed.ends == 1
    assert sum(one.outcome is Outcome.UNKNOWN for one in asked) <= frames
    assert sum(one.outcome is Outcome.REPLY for one in asked) >= 15
    assert world.finish() == []


def test_a_unit_that_is_silent_for_one_register_is_not_dead() -> None:
    world = World(PLAIN)
    world.slaves[10].habit = lambda frame: Reaction("deaf" if frame[3] == 5 and frame[1] == 3 else "ok")
    wait(world, read(world, 0))
    for _ in range(8):
        wait(world, read(world, 5), 1.0)
    world.run(world.now + 2.5)
    one = read(world, 0)
    wait(world, one, 1.0)
    assert one.outcome is Outcome.REPLY
    assert world.finish() == []


def test_a_unit_that_answers_one_register_with_another_length_is_not_dead() -> None:
    world = World(PLAIN)
    short = framed(bytes((10, 3, 2, 0, 1)))
    world.slaves[10].habit = lambda frame: Reaction("instead", data=short) if frame[3] == 5 else Reaction()
    wait(world, read(world, 0))
    for _ in range(8):
        wait(world, read(world, 5), 1.0)
    world.run(world.now + 2.5)
    one = read(world, 0)
    wait(world, one, 1.0)
    assert one.outcome is Outcome.REPLY
    assert world.finish() == []
