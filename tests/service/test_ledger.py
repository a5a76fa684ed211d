"""What the ledger remembers, and over what."""

from __future__ import annotations

import asyncio
import sqlite3
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from rs485bus.errors import BusError
from rs485bus.service.clerk import Clerk
from rs485bus.service.ledger import KEPT, Ledger
from rs485bus.service.schema import Answer

DONE = Answer(id="1", outcome="done", value=3.0, now=0.0)


def test_an_id_is_remembered_with_its_answer(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "deep" / "cell.sqlite")
    store = partial(Ledger.store, request="1", digest="d")
    assert ledger.carry_out([store, partial(Ledger.settle, request="1", answer=DONE)]) == [None, None]
    ledger.close()
    again = Ledger(tmp_path / "deep" / "cell.sqlite")
    assert again.carry_out([store]) == [("d", DONE)]
    assert again.recover() == (0, frozenset())
    again.close()


def test_of_entries_one_of_which_fails_none_is_kept() -> None:
    ledger = Ledger(":memory:")

    def fails(ledger: Ledger) -> None:
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="full"):
        ledger.carry_out([partial(Ledger.store, request="1", digest="d"), fails])
    assert ledger.look_up("1") is None


def test_what_was_stored_is_there_after_the_program_was_killed(tmp_path: Path) -> None:
    path = tmp_path / "cell.sqlite"
    script = (
        "import os, sys; from rs485bus.service.ledger import Ledger\n"
        "ledger = Ledger(sys.argv[1])\n"
        "ledger.carry_out([lambda ledger: ledger.store('1', 'd'), lambda ledger: ledger.hold(frozenset('x'))])\n"
        "os.kill(os.getpid(), 9)"
    )
    subprocess.run((sys.executable, "-c", script, str(path)), check=False)
    ledger = Ledger(path)
    assert ledger.recover() == (1, frozenset("x"))
    former = ledger.look_up("1")
    assert former is not None
    assert former.answer.outcome == "unknown"
    ledger.close()


def test_an_hour_later_what_has_an_answer_is_forgotten(tmp_path: Path) -> None:
    now = [1000.0]
    ledger = Ledger(tmp_path / "cell.sqlite", lambda: now[0])
    for request in "12":
        ledger.carry_out([partial(Ledger.store, request=request, digest="d")])
    ledger.carry_out([partial(Ledger.settle, request="1", answer=DONE)])
    now[0] += KEPT - 1
    ledger.carry_out([partial(Ledger.look_up, request="1")])
    assert ledger.look_up("1") is not None
    now[0] += KEPT / 30
    ledger.carry_out([])
    assert ledger.look_up("1") is None
    assert ledger.look_up("2") is not None
    ledger.close()


def test_an_hour_is_what_has_passed_and_not_what_somebody_sets_the_clock_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else what is said again would be done again."""
    at, passed = time.time(), [1000.0]
    monkeypatch.setattr("rs485bus.service.clock._passed", lambda: passed[0])
    ledger = Ledger(":memory:")
    ledger.carry_out([partial(Ledger.store, request="1", digest="d"), partial(Ledger.settle, request="1", answer=DONE)])
    monkeypatch.setattr(time, "time", lambda: at + 5 * KEPT)
    ledger.carry_out([])
    assert ledger.look_up("1") is not None
    passed[0] += 2 * KEPT
    ledger.carry_out([])
    assert ledger.look_up("1") is None
    ledger.close()


def test_a_second_service_of_the_plant_is_told_to_stop_the_first(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "cell.sqlite")
    with pytest.raises(BusError, match="another service of this plant"):
        Ledger(tmp_path / "cell.sqlite")
    ledger.close()


def test_a_file_of_something_else_is_not_written_to(tmp_path: Path) -> None:
    path = tmp_path / "cell.sqlite"
    base = sqlite3.connect(path)
    base.execute("PRAGMA user_version = 7")
    base.close()
    with pytest.raises(BusError, match="another release"):
        Ledger(path)
    (tmp_path / "text").write_text("no database, but text that is long enough to be looked at " * 50)
    with pytest.raises(BusError, match="not a database"):
        Ledger(tmp_path / "text")


def test_entries_are_written_in_order_and_the_event_loop_does_not_wait() -> None:
    async def main() -> None:
        ledger = Ledger(":memory:")
        clerk = Clerk(ledger)
        told: list[object] = []
        for number in range(50):
            clerk.write(
                partial(Ledger.store, request=str(number), digest="d"), lambda result, error: told.append(error)
            )
            clerk.write(partial(Ledger.look_up, request=str(number)), lambda result, error: told.append(result.digest))
        assert told == []
        await clerk.drain()
        assert told == [None, "d"] * 50
        ledger.close()

    asyncio.run(main())


def test_who_waits_for_an_entry_that_cannot_be_written_is_told() -> None:
    async def main() -> None:
        ledger = Ledger(":memory:")
        clerk = Clerk(ledger)
        ledger.close()
        told: list[Exception | None] = []
        clerk.write(partial(Ledger.look_up, request="1"), lambda result, error: told.append(error))
        await clerk.drain()
        assert isinstance(told[0], sqlite3.ProgrammingError)

    asyncio.run(main())


def test_an_entry_whose_teller_fails_leaves_nobody_else_waiting() -> None:
    async def main() -> None:
        clerk = Clerk(Ledger(":memory:"))
        told: list[object] = []

        def fail(result: object, error: Exception | None) -> None:
            raise KeyError("a surprise")

        clerk.write(partial(Ledger.look_up, request="1"), fail)
        clerk.write(partial(Ledger.look_up, request="1"), lambda result, error: told.append(error))
        await clerk.drain()
        assert told == [None]

    asyncio.run(main())


def test_an_axis_that_was_commanded_is_held_though_that_could_not_be_stored_when_control_was_taken() -> None:
    ledger = Ledger(":memory:")
    ledger.carry_out([lambda ledger: ledger.store("1", "digest", frozenset("x"))])
    assert ledger.recover() == (1, frozenset("x"))
    ledger.close()


def test_a_disk_that_is_full_is_told_as_that_and_later_entries_are_stored(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "l.sqlite")
    pages = ledger._base.execute("PRAGMA page_count").fetchone()[0]
    ledger._base.execute(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(sqlite3.Error, match="full"):
        ledger.carry_out([lambda ledger, n=n: ledger.store(f"{n}" * 60, "d" * 500) for n in range(100)])
    ledger._base.execute("PRAGMA max_page_count = 100000")
    assert ledger.carry_out([lambda ledger: ledger.store("1", "digest")]) == [None]
    ledger.close()
