"""Whatever a drive or a gateway says to a frame of a command: one that fails leaves no motor going.

A drive that refuses may have begun it all the same, and what it did before it goes on doing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from rs485bus.bus.handle import Handle
from rs485bus.devices.axis import Axis
from rs485bus.errors import BusError
from rs485bus.sim import SimZlac
from rs485bus.wire.frames import crc
from tests.devices.group_plant import LEFT, MKS, TLR, Plant, plant
from tests.integration.support import virtual

VERBS: dict[str, Callable[[Any], Handle[Any]]] = {
    "move_to": lambda axis: axis.move_to(200.0, rpm=300),
    "run": lambda axis: axis.run(120.0),
    "run for a time": lambda axis: axis.run(120.0, duration=30.0),
    "home": lambda axis: axis.home(),
    "torque": lambda axis: axis.torque(800),
}
CASES = [
    (kind, verb, runs)
    for kind in (MKS, TLR, LEFT)
    for verb in VERBS
    for runs in (False, True)
    if verb not in {MKS: ("torque",), TLR: ("torque",), LEFT: ("home",)}[kind]
]


def moves(plant: Plant) -> bool:
    """Whether the shaft turns now, whatever the drive was asked since."""
    sim = plant.sims["a"]
    if isinstance(sim, SimZlac):
        sim.advance(plant.now)
        return plant.moving("a")
    return sim.moving(plant.now)  # type: ignore[attr-defined, no-any-return]


class Spoiler:
    """Answers the write of the number given, of those that are sent to a drive, by an exception."""

    def __init__(self, plant: Plant, number: int, code: int, done: bool) -> None:
        self.spoilt = False
        self._sim = plant.sims["a"]
        self._left, self._code, self._done = number, code, done
        self._receive = self._sim.receive
        self._sim.receive = self.receive  # type: ignore[method-assign]

    def receive(self, frame: bytes, now: float) -> bytes | None:
        self._left -= frame[1] in (6, 16)
        if self.spoilt or self._left:
            return self._receive(frame, now)
        self.spoilt = True
        if self._done:
            self._receive(frame, now)
        body = bytes((frame[0], frame[1] | 0x80, self._code))
        return body + crc(body)


async def fails_and_leaves_it_going(
    kind: str, verb: str, runs: bool, number: int, code: int, done: bool
) -> tuple[bool, bool]:
    """Whether there was such a frame, and whether the command failed and its motor turns three seconds later."""
    async with plant(kind) as made:
        axis: Axis = made.axes["a"]
        if runs:
            await axis.run(60.0)
        spoiler = Spoiler(made, number, code, done)
        handle = VERBS[verb](axis)
        try:
            await asyncio.wait_for(handle.wait(), 10)
            failed = False
        except BusError:
            failed = True
        except TimeoutError:
            failed = False
        await asyncio.sleep(3.0)
        going = failed and moves(made)
        await axis.emergency_stop()
        return spoiler.spoilt, going


@pytest.mark.parametrize(("code", "done"), [(3, False), (3, True), (5, True), (11, True)])
@pytest.mark.parametrize(("kind", "verb", "runs"), CASES)
def test_a_command_that_fails_leaves_no_motor_going(kind: str, verb: str, runs: bool, code: int, done: bool) -> None:
    """Each of its writes in turn is answered so, be it carried out or not."""

    @virtual
    async def run() -> None:
        number, there = 1, True
        while there:
            there, going = await fails_and_leaves_it_going(kind, verb, runs, number, code, done)
            assert not going, f"after write {number}"
            number += 1

    run()
