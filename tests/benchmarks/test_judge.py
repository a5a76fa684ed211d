"""Every kind of lie is found, and nothing that is true is called one."""

from typing import Any

import pytest

from benchmarks.judge import judge

PDU = "0300020003"
"""Three registers from the second on."""


def told(reads: list[Any] | None = None, writes: list[Any] | None = None) -> dict[str, Any]:
    return {"reads": reads or [], "writes": writes or [], "requests": 1, "failed": 0, "cancelled": 0}


def known(reads: list[Any] | None = None, writes: list[Any] | None = None) -> dict[str, Any]:
    return {"reads": reads or [], "writes": writes or [], "early": 0}


def write(token: int) -> str:
    return f"100000000204{token:08x}"


def test_the_answer_to_the_request_is_right() -> None:
    verdict = judge(told([(4, 2, 3, 10.0, [0, 0, 0])]), known([(10.1, 4, PDU)]))
    assert verdict["lies"] == 0


@pytest.mark.parametrize(
    ("answered_by", "pdu", "values"),
    [
        (5, PDU, [0, 0, 0]),
        (4, "0300010003", [0, 0, 0]),
        (4, PDU, [0, 0]),
        (4, PDU, [0, 9, 0]),
    ],
    ids=["another unit's", "another register's", "too short", "nobody's"],
)
def test_an_answer_to_another_request_is_wrong(answered_by: int, pdu: str, values: list[int]) -> None:
    verdict = judge(told([(4, 2, 3, 10.0, values)]), known([(10.1, answered_by, pdu)]))
    assert (verdict["wrong"], verdict["lies"]) == (1, 1)


def test_an_answer_given_before_it_was_asked_for_is_stale() -> None:
    verdict = judge(told([(4, 2, 3, 10.0, [0, 0, 0])]), known([(9.9, 4, PDU)]))
    assert (verdict["stale"], verdict["lies"]) == (1, 1)


def test_a_write_reported_done_that_was_not_is_a_lie() -> None:
    assert judge(told(writes=[(1, 7, True)]), known())["undone"] == 1
    assert judge(told(writes=[(1, 7, True)]), known(writes=[(1.0, 1, write(7))]))["undone"] == 0
    assert judge(told(writes=[(1, 7, False)]), known())["undone"] == 0


def test_a_write_done_twice_is_counted() -> None:
    done = [(1.0, 1, write(7)), (2.0, 1, write(7)), (2.0, 2, write(7))]
    assert judge(told(writes=[(1, 7, False)]), known(writes=done))["twice"] == 1
    assert judge(told(writes=[(2, 7, True)]), known(writes=done))["twice"] == 0
