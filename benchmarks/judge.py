"""Holds what a client was told against what the witnesses on the line did."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from benchmarks.tasks.task import Result

WRONG, STALE, TWICE, UNDONE = "wrong", "stale", "twice", "undone"


def judge(told: Result, known: Result) -> dict[str, float]:
    """How often the client was told something that is not so.

    `wrong`: an answer to another request. `stale`: to an equal one asked earlier. `undone`: a write reported done that
    was not. `twice`: a write that was asked for once and done more than once.
    """
    counts = {WRONG: 0, STALE: 0, UNDONE: 0, TWICE: 0}
    for unit, register, count, asked_at, values in told["reads"]:
        verdict = _read(known["reads"], unit, register, count, asked_at, values)
        if verdict:
            counts[verdict] += 1
    done = _tokens(known["writes"])
    for unit, token, reported in told["writes"]:
        times = done[unit, token]
        counts[UNDONE] += reported and not times
        counts[TWICE] += times > 1
    return {
        **counts,
        "lies": counts[WRONG] + counts[STALE] + counts[UNDONE],
        "requests": told["requests"],
        "failed": told["failed"],
        "cancelled": told["cancelled"],
        "early": known["early"],
    }


def _read(reads: list[Any], unit: int, register: int, count: int, asked_at: float, values: list[int]) -> str:
    if len(values) != count:
        return WRONG
    serial = values[0] << 16 | values[1]
    if serial >= len(reads):
        return WRONG
    answered_at, answered_by, pdu = reads[serial]
    if answered_by != unit or pdu != f"03{register:04x}{count:04x}":
        return WRONG
    return STALE if answered_at < asked_at else ""


def _tokens(writes: list[Any]) -> dict[tuple[int, int], int]:
    """How often each unit did the write with each token."""
    done: dict[tuple[int, int], int] = defaultdict(int)
    for _, unit, pdu in writes:
        frame = bytes.fromhex(pdu)
        if frame[0] == 16:
            done[unit, int.from_bytes(frame[6:10], "big")] += 1
    return done
