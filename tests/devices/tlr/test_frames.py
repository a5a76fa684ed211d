"""The printed frames are built byte for byte, and answered byte for byte."""

import json
from pathlib import Path

import pytest

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.frames import control, read, write
from rs485bus.devices.tlr.values import ControlWord
from rs485bus.sim import SimTlr
from rs485bus.wire.frames import Request, crc

VECTORS = json.loads((Path(__file__).parents[2] / "vectors" / "tlr.json").read_text())
BUILT = {
    "tlr-001": read(1, r.SPEED),
    "tlr-003": write(1, r.POSITION_PATHS[5].fields[1].address, (20,)),  # type: ignore[attr-defined] # a Register
    "tlr-005": write(1, r.SPEED_PATHS[0].address, (1000, 100)),
}
REQUESTS = [vector for vector in VECTORS if vector["direction"] == "request"]
ANSWERS = {vector["pair"]: vector for vector in VECTORS if vector["direction"] == "response" and "pair" in vector}


def as_bytes(vector: dict[str, str]) -> bytes:
    return bytes.fromhex(vector["hex"])


def test_every_frame_has_a_valid_crc() -> None:
    assert len(VECTORS) == 7
    for vector in VECTORS:
        frame = as_bytes(vector)
        assert crc(frame[:-2]) == frame[-2:], vector["id"]


@pytest.mark.parametrize("vector", REQUESTS, ids=lambda vector: vector["id"])
def test_a_printed_request_is_built(vector: dict[str, str]) -> None:
    assert BUILT[vector["id"]].adu == as_bytes(vector)


@pytest.mark.parametrize("vector", REQUESTS, ids=lambda vector: vector["id"])
def test_a_printed_request_is_answered_as_printed(vector: dict[str, str]) -> None:
    assert SimTlr(1).receive(as_bytes(vector), 1.0) == as_bytes(ANSWERS[vector["pair"]])


@pytest.mark.parametrize("vector", REQUESTS, ids=lambda vector: vector["id"])
def test_a_printed_answer_fits_its_request(vector: dict[str, str]) -> None:
    request: Request = BUILT[vector["id"]]
    answer = as_bytes(ANSWERS[vector["pair"]])
    assert answer.startswith(request.prefix)
    assert len(answer) == request.length


def test_execution_denied_is_answered_as_it_should_have_been_printed() -> None:
    sim = SimTlr(1)
    sim.fail(1, 1.0)
    denied = sim.receive(control(1, ControlWord.JOG).adu, 1.0)
    assert denied == as_bytes(next(vector for vector in VECTORS if vector["id"] == "tlr-007"))
    assert denied == bytes.fromhex("01 86 04 43 A3")
