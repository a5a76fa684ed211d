"""A few levels of what `python -m rs485bus.sim.small_worlds` explores; and in each world a defence is taken away."""

from collections.abc import Callable

import pytest

from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.stopping.stops import Stops
from rs485bus.bus.watchdog.feeding import Feeding
from rs485bus.sim.campaigns.small import explore
from rs485bus.sim.campaigns.small.explore import Explored, expand
from rs485bus.sim.campaigns.small.world import WORLDS, World

DEPTH = 4


def explored(name: str, depth: int, only: str = "", begin: str = "") -> Explored:
    found, seen, level = Explored(name), {World(name, begin).fingerprint()}, [begin]
    for _ in range(depth):
        following = expand(name, level, only)
        level = []
        for path, number, wrong in following:
            for what in wrong:
                found.wrong.setdefault(what, path)
            if number not in seen:
                seen.add(number)
                level.append(path)
    found.states = len(seen)
    return found


@pytest.mark.parametrize("name", list(WORLDS))
def test_nothing_is_wrong_in_the_first_levels(name: str) -> None:
    found = explored(name, DEPTH)
    assert found.wrong == {}
    assert found.states > 300


def test_two_paths_to_the_same_state_have_the_same_number() -> None:
    one, other = World("stop", "1U2"), World("stop", "1U2")
    assert one.fingerprint() == other.fingerprint()
    assert one.fingerprint() != World("stop", "1U").fingerprint()


Patch = Callable[[pytest.MonkeyPatch], None]


def no_epochs(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Job, "is_stale", property(lambda job: False))


def no_waiting(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(PendingReplies, "must_wait", lambda late, request, job=None: 0.0)


def order_everywhere(patch: pytest.MonkeyPatch) -> None:
    init = PendingReplies.__init__
    patch.setattr(PendingReplies, "__init__", lambda late, in_order=True: init(late, True))


def no_locks(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Stops, "trip", lambda stops, watch, reason: stops._feeding.trip(watch))


def no_feeds(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Feeding, "due", lambda feeding, now: None)
    patch.setattr(Feeding, "soon", lambda feeding, now: None)


@pytest.mark.parametrize(
    ("name", "begin", "only", "depth", "removed", "found"),
    [
        ("stop", "", "23TR", 6, no_epochs, "older than a stop, and is sent after it"),
        ("verified", "21", "3TR", 5, no_epochs, "older than a stop, and is sent after it"),
        ("burst", "", "123TR", 4, no_epochs, "older than a stop, and is sent after it"),
        ("two-reads", "", "12TDP", 7, no_waiting, "given the answer to another request"),
        ("watchdog", "1RTR", "2TL", 24, no_locks, "moves a drive that its watchdog has stopped"),
        ("watchdog", "1RTR", "23TR", 4, no_feeds, "the drive trips, though all that it is asked is answered"),
        ("gateway", "1TDT3TR", "12TDPR", 3, order_everywhere, "given the answer to another request"),
    ],
)
def test_a_defence_that_is_taken_away_is_missed(
    name: str, begin: str, only: str, depth: int, removed: Patch, found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(explore, "_FINISHED", 1)  # every state is followed to its end
    assert explored(name, depth, only, begin).wrong == {}
    removed(monkeypatch)
    assert any(found in what for what in explored(name, depth, only, begin).wrong)
