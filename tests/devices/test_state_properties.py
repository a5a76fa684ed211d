"""What is known of drives and their axes, whatever is answered when: properties."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rs485bus.bus.units.motion import Motion
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.values import Model, MotionDirection, WorkMode
from rs485bus.devices.tlr.drive import TlrDrive
from rs485bus.devices.zlac.ability import ZlacOptions
from rs485bus.devices.zlac.drive import ZlacDrive
from rs485bus.motion.drive import Drive
from rs485bus.motion.events import Changes, EventKind
from rs485bus.motion.standstill import NEVER, StandstillRule
from rs485bus.motion.state import FRESH, MOTION, AxisState, DriveState, Fact
from rs485bus.sim import SimMks, SimTlr, SimZlac
from rs485bus.sim.motor import Motor
from rs485bus.wire.crc import crc
from rs485bus.wire.frames import Request

FACTS = (Fact.POSITION, Fact.RUNNING, Fact.SPEED, Fact.ENABLED, Fact.FAULT)
VALUES = {Fact.POSITION: st.integers(-50, 50), Fact.RUNNING: st.booleans(), Fact.SPEED: st.integers(-5, 5)}
RULE = StandstillRule(apart=0.05, contradicted=0.5)

times = st.floats(0.0, 0.3, allow_nan=False)
replies = st.tuples(
    st.just("reply"),
    times,
    times,
    st.lists(st.sampled_from(FACTS), min_size=1, unique=True).flatmap(
        lambda facts: st.fixed_dictionaries({fact: VALUES.get(fact, st.booleans()) for fact in facts})
    ),
)
writes = st.tuples(st.just("write"), times, st.sets(st.sampled_from(FACTS), min_size=1))
histories = st.lists(st.one_of(replies, writes), max_size=30)
few = settings(max_examples=60, deadline=None)


@few
@given(histories)
def test_nothing_older_replaces_newer_and_nothing_that_was_asked_before_a_change_is_evidence(
    history: list[Any],
) -> None:
    axis, now = AxisState(Motion(), RULE, jump=10), 0.0
    told: dict[Fact, dict[float, list[Any]]] = {fact: {} for fact in Fact}
    changed = dict.fromkeys(Fact, NEVER)
    for what, pause, *rest in history:
        now += pause
        before = {fact: axis.last(fact).at for fact in FACTS}
        if what == "write":
            axis.change(rest[0], now)
            changed.update(dict.fromkeys(rest[0], now))
        else:
            age, facts = rest
            axis.learn(facts, now - age, now)
            for fact, value in facts.items():
                told[fact].setdefault(now - age, []).append(value)
        for fact in FACTS:
            known = axis.known(fact)
            assert axis.last(fact).at >= before[fact]
            if known.at != NEVER:
                assert known.at >= changed[fact]
                assert known.value in told[fact][known.at]
        assert axis.standstill.until == NEVER or axis.standstill.until >= changed[Fact.POSITION]


@few
@given(st.lists(st.tuples(times, VALUES[Fact.POSITION]), min_size=1, unique_by=lambda each: each[0]), st.randoms())
def test_in_whatever_order_replies_come_the_one_that_was_asked_last_counts(
    asked: list[tuple[float, int]], rng: random.Random
) -> None:
    axis, mixed = AxisState(Motion(), RULE, jump=10), list(asked)
    rng.shuffle(mixed)
    for at, position in mixed:
        axis.learn({Fact.POSITION: position}, at, 1.0)
    last = max(asked)
    assert axis.known(Fact.POSITION) == (last[1], last[0])
    assert axis.standstill.until == last[0]


@few
@given(st.lists(st.tuples(st.floats(0.0, 1.0), times), min_size=1, max_size=20), times)
def test_what_was_asked_before_a_silence_does_not_show_that_a_drive_has_not_restarted_in_it(
    answers: list[tuple[float, float]], later: float
) -> None:
    drive, now = DriveState((AxisState(Motion(), RULE, jump=10),)), 0.0
    silence_ended, heard = NEVER, NEVER
    for pause, age in answers:
        now += pause
        if now > heard + FRESH:
            silence_ended = heard  # whatever was asked by then may be older than a restart
        heard = now
        drive.hear(now - age, now, ({},))
    assert drive.unsure_since(now + later) > silence_ended or silence_ended == NEVER
    assert drive.unsure_since(now + later) <= now + later


def test_two_positions_of_which_the_first_was_asked_for_twice_are_as_far_apart_as_their_answers() -> None:
    drive = DriveState((AxisState(Motion(), RULE, jump=10),))
    drive.hear(0.0, 0.005, ({Fact.RUNNING: False},))
    drive.hear(0.1, 0.205, ({Fact.POSITION: 0},))  # its first attempt was lost
    drive.hear(0.21, 0.215, ({Fact.POSITION: 0},))
    assert drive.axes[0].stands is not True
    drive.hear(0.251, 0.256, ({Fact.POSITION: 0},))
    assert drive.axes[0].stands is True


@pytest.mark.parametrize(
    ("stood", "aim", "position", "may_have_restarted"),
    [
        (74_000, -1000, 7000, False),  # on its way from there; from zero it would never come by
        (74_000, 5000, 7000, False),
        (74_000, 7000, 7000, True),  # it has arrived, from wherever
        (74_000, 90_000, 7000, True),
        (22_000, 90_000, 22_000, False),  # it stands yet where it stood
        (22_000, 22_000, 22_000, True),
        (22_000, None, 22_000, True),  # by a way
        (74_000, None, 7000, True),
    ],
)
def test_a_drive_that_was_told_a_move_while_it_was_silent_has_restarted_only_if_it_can_have_come_from_zero(
    stood: int, aim: int | None, position: int, *, may_have_restarted: bool
) -> None:
    axis = AxisState(Motion(), RULE, jump=100)
    drive = DriveState((axis,))
    drive.hear(0.0, 0.005, ({Fact.POSITION: stood},), tells_restarts=False)
    axis.stood()
    axis.change(MOTION, 0.1)
    axis.start(200_000.0, 0.1, aim)
    axis.motion.commanded(0.1)
    for sent_at in (0.1, 0.2, 0.3, 0.4):
        drive.silence.missed(sent_at)
    drive.hear(0.5, 0.505, ({Fact.RUNNING: True},), tells_restarts=False)
    drive.hear(0.9, 0.905, ({Fact.POSITION: position},), tells_restarts=False)
    assert bool(axis.lost) is may_have_restarted


# The families: drives that answer as they are, late and in any order, while anybody writes


@dataclass(frozen=True)
class Kind:
    """A drive, its virtual twin, and what somebody may send them."""

    drive: Callable[[], Drive]
    sim: Callable[[], Any]
    motors: Callable[[Any], Sequence[Motor]]
    writes: Callable[[Drive, float], list[Request]]
    broadcasts: bool = False


def _setpoints(drive: Drive, rpm: float) -> list[Request]:
    return [frame for axis in range(len(drive.state.axes)) for frame in drive.setpoint(axis, rpm, 500.0, afresh=True)]


def _mks() -> Drive:
    ways = MotionDirection.CCW
    return MksDrive(1, model=Model.SERVO42D, mode=WorkMode.SR_VFOC, microsteps=16, positive=ways)


def _tlr() -> Drive:
    return TlrDrive(
        1,
        pulses_per_turn=4000,
        start_rpm=0,
        clear_trigger=True,
        block_writes=True,
        keeps_target=True,
        enabled_bit=False,
        live_jog=False,
        ramp_rpm=None,
    )


def _zlac() -> Drive:
    drive = ZlacDrive(1, ZlacOptions(speed_resolution=1))
    drive.learn((4096, 4096))
    return drive


def _zlac_sim() -> SimZlac:
    sim = SimZlac(1, watchdog=0)
    for word in ((0x200D, 3), (0x200E, 8)):
        frame = bytes([1, 6]) + word[0].to_bytes(2, "big") + word[1].to_bytes(2, "big")
        sim.receive(frame + crc(frame), 0.0)
    return sim


KINDS = {
    "MKS": Kind(_mks, lambda: SimMks(1), lambda sim: (sim.motion.motor,), _setpoints, broadcasts=True),
    "TL-R": Kind(_tlr, lambda: SimTlr(1), lambda sim: (sim.motion.motor,), _setpoints),
    "ZLAC": Kind(_zlac, _zlac_sim, lambda sim: (sim.left.motor, sim.right.motor), _setpoints),
}
steps = st.lists(
    st.one_of(
        st.tuples(st.just("ask"), st.floats(0.0, 0.1), st.integers(0, 9), st.floats(0.0, 0.4)),
        st.tuples(
            st.just("write"), st.floats(0.0, 0.1), st.sampled_from([0.0, 3.0, 60.0, -60.0, 300.0]), st.booleans()
        ),
        st.tuples(st.just("deliver"), st.floats(0.0, 0.1), st.integers(0, 9), st.none()),
    ),
    min_size=5,
    max_size=40,
)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@settings(max_examples=60, deadline=None)
@given(steps)
def test_what_is_said_to_stand_stood_when_it_was_asked_last_whoever_writes_and_however_late_replies_come(
    kind: Kind, history: list[Any]
) -> None:
    drive, sim, now = kind.drive(), kind.sim(), 1.0
    on_their_way: list[tuple[Request, bytes, float]] = []
    changed = [NEVER] * len(drive.state.axes)
    for what, pause, choice, extra in history:
        now += pause
        if what == "ask":
            request = drive.readings[choice % len(drive.readings)].request
            reply = sim.receive(request.adu, now)
            if reply is not None:
                on_their_way.append((request, reply, now))
                if extra < 0.2:
                    drive.on_reply(*on_their_way.pop(), now + extra / 10)
        elif what == "write":
            for frame in kind.writes(drive, choice):
                address = 0 if extra and kind.broadcasts else 1
                body = bytes([address]) + frame.adu[1:-2]
                drive.on_sent(frame, now)
                sim.receive(body + crc(body), now)
                for axis, effect in enumerate(drive.effects(frame)):
                    changed[axis] = now if effect.changes & MOTION else changed[axis]
        elif on_their_way:
            request, reply, asked_at = on_their_way.pop(choice % len(on_their_way))
            drive.on_reply(request, reply, asked_at, now)
        for axis, state in enumerate(drive.state.axes):
            assert all(state.known(fact).at == NEVER or state.known(fact).at >= changed[axis] for fact in MOTION)
            until = state.standstill.until
            if state.stands:
                assert until >= changed[axis]
                assert not kind.motors(sim)[axis].moving(until)


def test_a_reported_stall_is_an_event_as_soon_as_positions_do_not_show_that_the_motor_turns() -> None:
    state, told = AxisState(Motion(), RULE, jump=100), list[EventKind]()
    changes = Changes(state, lambda kind, what: told.append(kind))
    state.motion.commanded(1.0)
    for at, position in ((1.1, 0), (1.2, 500), (1.3, 1000)):
        state.learn({Fact.POSITION: position, Fact.RUNNING: True}, at, at)
    state.learn({Fact.STALLED: True}, 1.31, 1.31)
    changes.look()
    assert told == []
    for number in range(20):
        state.learn({Fact.POSITION: 1000, Fact.RUNNING: True}, 1.4 + number / 10, 1.4 + number / 10)
        changes.look()
    assert told == [EventKind.STALL]
