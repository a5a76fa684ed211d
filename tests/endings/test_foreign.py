"""Lines, slaves, adapters and gateways as users of other Modbus software have met them, each as a small emulator.

Where the situation was reported publicly, the report is named. For each, the best true end is asserted; the judge of
`world.py` holds every outcome against what the slaves really did.
"""

from __future__ import annotations

import pytest

from rs485bus.bus.schedule.job import Outcome, Urgency
from rs485bus.wire.frames import read_holding, write_single
from rs485bus.wire.registers import Repeat
from tests.endings.cable import framed
from tests.endings.program import PLAIN, all_done, read, wait, work, write
from tests.endings.records import Setting, Step
from tests.endings.slaves import Reaction
from tests.endings.world import World


def test_an_adapter_that_returns_now_the_whole_now_a_part() -> None:
    # rosenrot00/esphome_modbus_bridge#21: full echoes, partial echoes and stray bytes mixed
    world = World(Setting(echo="full", echo_config="auto"))
    kinds = ["full", "damaged", "full", "split", "damaged"]
    asked = []
    for at in range(20):
        world.cable.echo = kinds[at % 5]
        asked.append(read(world, at % 3) if at % 2 else write(world, at))
        wait(world, asked[-1])
    ends = {one.outcome for one in asked}
    assert ends <= {Outcome.REPLY, Outcome.UNKNOWN}
    assert [one.outcome for one in asked if not one.job.request.writes] == [Outcome.REPLY] * 10
    assert world.finish() == []


@pytest.mark.parametrize("echo", ["full", "split"])
def test_a_first_read_that_nobody_answers_says_nothing_of_the_echo(echo: str) -> None:
    world = World(Setting(echo=echo, echo_config="auto"))
    nobody = world.submit(read_holding(20, 0, 2))
    wait(world, nobody)
    assert nobody.outcome is Outcome.NO_REPLY
    lost = world.submit(write_single(20, 1, 5), repeat=Repeat.NEVER, moves=True)
    wait(world, lost)
    assert lost.outcome in (Outcome.UNKNOWN, Outcome.NOT_SENT)
    assert world.finish() == []


def test_a_slave_that_says_everything_twice() -> None:
    # pymodbus-dev/pymodbus#207: a heat pump with more than one answer
    world = World(PLAIN)
    world.slaves[10].habit = lambda frame: Reaction("double")
    all_done(world, work(world))


def test_a_slave_that_answers_under_another_address() -> None:
    world = World(PLAIN)
    world.slaves[10].habit = lambda frame: Reaction("instead", data=framed(bytes((5, frame[1], 4, 0, 1, 0, 2))))
    one = read(world)
    wait(world, one)
    assert one.outcome is Outcome.NO_REPLY
    changed = write(world, 4)
    wait(world, changed)
    assert changed.outcome is Outcome.UNKNOWN
    assert world.finish() == []


def test_another_masters_dongle_asks_the_same_slave() -> None:
    # esphome/esphome#16621: replies of the same address and function, of another length, between ours
    world = World(PLAIN)
    asked = []
    for at in range(12):
        asked.append(read(world, at % 3, 2))
        world.cable.noise(framed(bytes((10, 3, 20)) + bytes(20)), world.now + 0.0)
        wait(world, asked[-1])
    assert all(one.outcome in (Outcome.REPLY, Outcome.NO_REPLY) for one in asked)
    assert world.finish() == []


@pytest.mark.parametrize("gateway", [False, True])
def test_a_slave_that_is_always_later_than_we_wait_never_answers_the_next_request(gateway: bool) -> None:
    # stephane/libmodbus#255, NModbus/NModbus#16, pymodbus#538: every reply comes one request too late
    world = World(Setting(echo_config=False, gateway=gateway))
    world.slaves[10].habit = lambda frame: Reaction("late", 0.05)
    asked = work(world)
    assert all(one.ends == 1 for one in asked)
    assert world.finish() == []


def test_a_gateway_that_reorders() -> None:
    world = World(Setting(echo_config=False, gateway=True))
    delays = iter([0.4, 0.1, 0.3, 0.05, 0.9, 0.0] * 20)
    world.slaves[10].habit = lambda frame: Reaction("late", next(delays))
    asked = [read(world, register % 4, 1 + register % 2) for register in range(6)]
    for one in asked:
        wait(world, one, 60)
    assert world.finish() == []


def test_a_gateway_that_says_0b_late_for_an_older_request() -> None:
    world = World(Setting(echo_config=False, gateway=True))
    kinds = iter([Reaction("late", 0.4), Reaction("late", 0.3), Reaction("late", 0.2)])
    world.slaves[10].habit = lambda frame: next(kinds, Reaction())
    one, other = read(world, 0), read(world, 1)
    world.run(world.now + 0.1)
    # for the first attempt, beside its real answer
    world.cable.noise(framed(bytes((10, 0x83, 11))), world.now)
    wait(world, one, 30)
    wait(world, other, 30)
    assert world.finish() == []


@pytest.mark.parametrize("code", [10, 11])
def test_a_gateways_own_exceptions_are_no_answers_of_the_unit(code: int) -> None:
    world = World(Setting(echo_config=False, gateway=True))
    world.slaves[10].habit = lambda frame: Reaction("done, exception", code)
    one = read(world)
    wait(world, one)
    assert one.outcome is Outcome.NO_REPLY
    changed = write(world, 3)
    wait(world, changed)
    assert changed.outcome is Outcome.UNKNOWN
    assert world.finish() == []


@pytest.mark.parametrize("code", [4, 5])
def test_a_write_done_and_answered_by_an_exception_is_unknown(code: int) -> None:
    world = World(PLAIN)
    world.slaves[10].reactions.append(Reaction("done, exception", code))
    changed = write(world, 3)
    wait(world, changed)
    assert changed.outcome is Outcome.UNKNOWN
    assert world.finish() == []


def test_busy_is_repeated_after_a_pause_where_repeating_is_allowed() -> None:
    world = World(PLAIN)
    world.slaves[10].reactions.append(Reaction("exception", 6))
    one = read(world)
    wait(world, one)
    assert one.outcome is Outcome.REPLY
    assert one.sent is not None
    assert one.sent[1].start - one.sent[0].end > 0.005
    assert world.finish() == []


def test_a_write_that_must_not_be_repeated_and_met_a_busy_slave_was_not_done() -> None:
    world = World(PLAIN)
    world.slaves[10].reactions.append(Reaction("exception", 6))
    changed = write(world, 3)
    wait(world, changed)
    assert changed.outcome in (Outcome.REFUSED, Outcome.REPLY)
    assert world.finish() == []


def test_a_drive_that_is_silent_while_it_moves_is_stopped_all_the_same() -> None:
    world = World(PLAIN)
    world.do_move(1, 60, 0.0)
    world.run(world.now + 0.1)
    drive = world.drives[1]
    drive.habit = lambda frame: Reaction("lost") if drive.moves(world.now) else Reaction()
    world.do_stop(1, True, False)
    world.run(world.now + 2)
    assert world.stops[0].told
    assert world.stops[0].told[0][1]
    assert world.finish() == []


def test_an_adapter_that_hands_over_every_sixteen_milliseconds() -> None:
    world = World(Setting(echo_config="auto", latency=0.016, baudrate=9600))
    all_done(world, work(world))


def test_a_unit_that_only_says_no_is_there() -> None:
    world = World(PLAIN)
    kinds = iter([Reaction("deaf"), *[Reaction("exception", 2)] * 3, Reaction("deaf")] * 40)
    world.slaves[10].habit = lambda frame: next(kinds)
    asked = []
    for _ in range(30):
        asked.append(read(world, 0))
        wait(world, asked[-1], 1.0)
    assert Outcome.NOT_SENT not in {one.outcome for one in asked}
    assert world.finish() == []


def test_a_dead_unit_behind_a_gateway_that_says_so_costs_the_others_little() -> None:
    world = World(Setting(echo_config=False, gateway=True))
    answer = framed(bytes((11, 0x83, 11)))
    world.slaves[11].habit = lambda frame: Reaction("instead", data=answer)
    world.slaves[11].turnaround = 0.08
    begun, answered = world.now, 0
    while world.now < begun + 10:
        world.submit(read_holding(11, 0, 2), expires_at=world.now + 0.5)
        one = read(world, 0)
        wait(world, one, 1.0)
        answered += one.outcome is Outcome.REPLY
    alone = World(Setting(echo_config=False, gateway=True))
    begun, best = alone.now, 0
    while alone.now < begun + 10:
        one = read(alone, 0)
        wait(alone, one, 1.0)
        best += 1
    assert answered >= 0.9 * best


def test_a_frame_with_a_step_is_played_as_it_is_written() -> None:
    """The emulators themselves: a slave that is asked answers, and its answer is its own."""
    world = World(PLAIN)
    world.step(Step(0.0, "read", (10, 1, 2, True, int(Urgency.COMMAND), 0.0)))
    world.run(world.now + 0.1)
    assert world.asked[0].outcome is Outcome.REPLY
    assert world.finish() == []
