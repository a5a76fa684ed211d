"""Drives that begin to answer later than anybody waits, while they are watched and looked at: every call still ends."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest

from rs485bus import MksServo, TlrStepper, open_bus
from rs485bus.errors import BusError, NotSent, StopUnconfirmed
from rs485bus.sim import SimMks, SimTlr, SimUnit, VirtualLine
from rs485bus.sim.treatment import PLAIN, Treatment
from tests.integration.support import virtual

Verb = Callable[[MksServo], Awaitable[Any]]


class Slow(SimMks):
    """A drive that takes its time."""

    takes = 0.005

    def receive(self, frame: bytes, now: float) -> bytes | None:
        reply = super().receive(frame, now)
        self.turnaround = self.takes
        return reply


@pytest.mark.parametrize(
    ("verb", "takes", "timeout", "turns"),
    [
        (MksServo.enable, 0.12, 2.0, True),
        (MksServo.status, 0.3, 0.8, True),  # it was fed by reads whose answers are like the one waited for
        (lambda x: x.run(70), 0.3, 0.8, True),
        (lambda x: x.run(70), 0.2, 0.8, False),  # it was told to stop again and again, and never seen to stand
    ],
    ids=["enable", "status", "run", "run-from-standing"],
)
@virtual
async def test_a_call_ends_though_the_drive_answers_later_than_it_is_waited_for(
    verb: Verb, takes: float, timeout: float, turns: bool
) -> None:
    sim = Slow(1)
    loop = asyncio.get_running_loop()
    took = error = None
    with suppress(BusError, ExceptionGroup):  # that it was not seen standing is told as well
        async with open_bus(VirtualLine(sim)) as bus:
            x = MksServo(bus, 1)
            async with bus.watchdog(x, timeout=timeout):
                await x.enable()
                if turns:
                    await x.run(60)
                sim.takes, begun = takes, loop.time()
                try:
                    async with asyncio.timeout(30):
                        await verb(x)
                except BusError as why:
                    error = why
                took = loop.time() - begun
    assert took is not None
    assert took < 20
    assert not isinstance(error, NotSent)  # its turn has come
    assert not sim.moving(loop.time())


@pytest.mark.parametrize("family", [MksServo, TlrStepper])
@virtual
async def test_a_stream_is_left_though_the_drive_acknowledges_its_end_too_late(
    family: type[MksServo] | type[TlrStepper],
) -> None:
    """The stand is told again and again; that puts off for ever when it should be seen."""
    sim = Slow(1) if family is MksServo else SimTlr(1)
    loop = asyncio.get_running_loop()
    left = ended = 0.0
    with suppress(ExceptionGroup):  # that it was not seen standing is told as well
        async with open_bus(VirtualLine(sim)) as bus:
            axis = family(bus, 1)
            await axis.enable()
            sim.turnaround = 0.2
            if isinstance(sim, Slow):
                sim.takes = 0.2
            with pytest.raises(StopUnconfirmed):
                async with asyncio.timeout(30), axis.stream() as setpoint:
                    setpoint(50)
                    await asyncio.sleep(0.5)
                    left = loop.time()
            ended = loop.time()
    assert 0 < ended - left < 10
    assert not sim.moving(loop.time())


@pytest.mark.parametrize("code", [None, 5])
@virtual
async def test_others_have_their_turns_while_one_that_answers_to_no_purpose_is_stopped_again_and_again(
    code: int | None,
) -> None:
    """It answers too late, or that it is still at it, and so is never taken for one that is not there."""
    sim = Slow(1)
    line = VirtualLine(sim, SimUnit(7, {0: 5}))
    loop = asyncio.get_running_loop()
    with suppress(ExceptionGroup):  # that it was not seen standing is told as well
        async with open_bus(line) as bus:
            x = MksServo(bus, 1)
            await x.enable()
            if code is None:
                sim.takes = 0.2
            else:
                line.pair.script = lambda frame, now: Treatment(code=code) if frame[0] == 1 else PLAIN
            until = loop.time() + 5
            report = await bus.emergency_stop()
            assert not report.devices[0].standing
            while loop.time() < until:
                async with asyncio.timeout(0.5):
                    assert await bus.unit(7).read_holding_registers(0, 1) == [5]
                await asyncio.sleep(0.02)
