"""Remembers which requests were begun, and what became of them: for an hour, and over a restart of the service."""

from __future__ import annotations

import sqlite3
import weakref
from collections.abc import Callable, Iterable
from pathlib import Path

from rs485bus.errors import BusError, OutcomeUnknown
from rs485bus.service.clock import Clock
from rs485bus.service.decisions import Former
from rs485bus.service.schema import Answer, read, write
from rs485bus.service.troubles import trouble

KEPT = 3600.0
"""Seconds for which an id is remembered."""
_SCHEMA = 1
_TABLES = """
CREATE TABLE requests (id TEXT PRIMARY KEY, at REAL NOT NULL, digest TEXT NOT NULL, answer BLOB) WITHOUT ROWID;
CREATE INDEX requests_by_age ON requests (at);
CREATE TABLE held (axis TEXT PRIMARY KEY) WITHOUT ROWID;
"""


class Ledger:
    """The ids of one plant, in a file of SQLite. What was stored is on the disk when a call returns.

    One program at a time has it open.

    Args:
        path: the file; it is made where there is none. ":memory:" for none at all.
        now: the time, in seconds; None for Unix time that goes on without a step, whatever becomes of the time of day:
            what is remembered for an hour is not forgotten at once where somebody sets the clock.

    Raises:
        BusError: another program has it open, or it cannot be written.
    """

    def __init__(self, path: str | Path, now: Callable[[], float] | None = None) -> None:
        self._now = now or Clock().now
        self._pruned = self._now()
        try:
            if str(path) != ":memory:":
                Path(path).parent.mkdir(parents=True, exist_ok=True)
            self._base = sqlite3.connect(path, timeout=0.5, isolation_level=None, check_same_thread=False)
            weakref.finalize(self, self._base.close)
            self._base.execute("PRAGMA locking_mode = EXCLUSIVE")
            self._base.execute("PRAGMA journal_mode = WAL")
            self._base.execute("PRAGMA synchronous = FULL")
            self._base.execute("BEGIN EXCLUSIVE")
            self._make_tables()
            self._base.execute("COMMIT")
        except (OSError, sqlite3.Error) as error:
            raise BusError(
                f"{path} cannot be used to remember requests ({error}). If another service of this plant runs, stop it "
                "first; else choose another place: --ledger PATH."
            ) from None

    def _make_tables(self) -> None:
        version = self._base.execute("PRAGMA user_version").fetchone()[0]
        if version == 0:
            for statement in _TABLES.split(";"):
                self._base.execute(statement)
            self._base.execute(f"PRAGMA user_version = {_SCHEMA}")
        elif version != _SCHEMA:
            raise sqlite3.DatabaseError(f"it was written by another release: version {version}, not {_SCHEMA}")

    def close(self) -> None:
        """Close the file."""
        self._base.close()

    def recover(self) -> tuple[int, frozenset[str]]:
        """What the service that ran last has left: how many requests have become unknown, and which axes it held.

        A request without an answer has become unknown; who asks again is told so.
        """
        open_ids = self._base.execute("SELECT id FROM requests WHERE answer IS NULL").fetchall()
        answered = [(write(_unknown(request, self._now())), request) for (request,) in open_ids]
        self._base.executemany("UPDATE requests SET answer = ? WHERE id = ?", answered)
        axes = frozenset(axis for (axis,) in self._base.execute("SELECT axis FROM held"))
        return len(answered), axes

    def carry_out(self, entries: Iterable[Callable[[Ledger], object]]) -> list[object]:
        """Some entries, as one transaction: all are on the disk afterwards, or none."""
        self._base.execute("BEGIN")
        try:
            results = [entry(self) for entry in entries]
            self._prune()
            self._base.execute("COMMIT")
        except BaseException:
            if self._base.in_transaction:  # where the disk is full, SQLite has ended it already
                self._base.execute("ROLLBACK")
            raise
        return results

    # Entries

    def look_up(self, request: str) -> Former | None:
        """What is known of an id."""
        row = self._base.execute("SELECT digest, answer FROM requests WHERE id = ?", (request,)).fetchone()
        if row is None:
            return None
        return Former(row[0], _unknown(request, self._now()) if row[1] is None else read(Answer, row[1]))

    def store(self, request: str, digest: str, axes: frozenset[str] = frozenset()) -> Former | None:
        """Store an id, unless it is known already; and that these axes are held, which may have failed before."""
        former = self.look_up(request)
        if former is None:
            self._base.execute("INSERT INTO requests VALUES (?, ?, ?, NULL)", (request, self._now(), digest))
            self._base.executemany("INSERT OR IGNORE INTO held VALUES (?)", [(axis,) for axis in sorted(axes)])
        return former

    def settle(self, request: str, answer: Answer) -> None:
        """Store what became of it."""
        self._base.execute("UPDATE requests SET answer = ? WHERE id = ?", (write(answer), request))

    def hold(self, axes: frozenset[str]) -> None:
        """Store which axes somebody commands."""
        self._base.execute("DELETE FROM held")
        self._base.executemany("INSERT INTO held VALUES (?)", [(axis,) for axis in sorted(axes)])

    def _prune(self) -> None:
        """Now and then, forget what is older than an hour and has an answer."""
        now = self._now()
        if not 0 <= now - self._pruned < KEPT / 60:
            self._pruned = now
            self._base.execute("DELETE FROM requests WHERE at < ? AND answer IS NOT NULL", (now - KEPT,))


def _unknown(request: str, now: float) -> Answer:
    error = OutcomeUnknown(
        f"What became of the request {request} could not be stored, as where the service is killed: nobody knows "
        "whether it was done. A service that is started again stops its axes first. Read where they are, then go on."
    )
    return Answer(id=request, outcome="unknown", error=trouble(error), now=now)
