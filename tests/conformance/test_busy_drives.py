"""A drive that puts off what it is told, because it is busy, is told it again while that is what it should do."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import pytest

from rs485bus import BusConfig
from rs485bus.errors import MotionError, MoveCancelled, RequestFailed
from rs485bus.wire.exceptions import BUSY
from rs485bus.wire.frames import crc
from tests.conformance.subjects import EACH, Rig, Subject, rig
from tests.devices.mks.bench import on_virtual_clock

WRITES = pytest.mark.parametrize("number", range(4))
PATIENT = BusConfig(retries=6)


def busy(on: Rig, number: int, times: int, *, restarts: bool = False) -> list[bytes]:
    """Have a drive be busy when it is told something for the so manieth time from now on, so often; and restart then.
    Returns what it puts off."""
    receive, heard = on.sim.receive, [0]
    put_off: list[bytes] = []

    def late(frame: bytes, at: float) -> bytes | None:
        if frame[0] == on.sim.address and frame[1] in (6, 16):
            if heard[0] == number and len(put_off) < times:
                put_off.append(frame)
                if restarts and len(put_off) == times:
                    on.subject.restarts(on.sim, at)
                refusal = bytes((frame[0], frame[1] | 0x80, BUSY))
                return refusal + crc(refusal)
            heard[0] += 1
        answer: bytes | None = receive(frame, at)
        return answer

    on.sim.receive = late
    return put_off


@EACH
@WRITES
@on_virtual_clock
async def test_a_drive_that_restarts_while_it_is_busy_goes_nowhere_by_its_new_zero(
    subject: Subject, number: int
) -> None:
    async with rig(subject, config=PATIENT) as on:
        await on.axis.move_to(5.0, rpm=600)
        put_off = busy(on, number, 4, restarts=True)
        with suppress(MotionError, RequestFailed):
            await on.axis.move_to(6.0, rpm=600)
        assert on.turns == pytest.approx(5.0 if put_off else 6.0, abs=0.01)


@EACH
@WRITES
@on_virtual_clock
async def test_a_drive_that_is_busy_for_a_while_does_what_it_is_told(subject: Subject, number: int) -> None:
    async with rig(subject, config=PATIENT) as on:
        await on.axis.move_to(5.0, rpm=600)
        busy(on, number, 3)
        await on.axis.move_to(6.0, rpm=600)
        assert on.turns == pytest.approx(6.0, abs=0.01)
        await on.axis.move_by(-6.0, rpm=600)
        assert on.turns == pytest.approx(0.0, abs=0.01)


@EACH
@WRITES
@on_virtual_clock
async def test_what_a_busy_drive_puts_off_moves_nothing_after_a_stop(subject: Subject, number: int) -> None:
    async with rig(subject, config=PATIENT) as on:
        await on.axis.move_to(5.0, rpm=600)
        put_off = busy(on, number, 99)
        move = on.axis.move_to(6.0, rpm=600)
        await asyncio.sleep(0.5)
        if not put_off:
            return
        put_off.extend([b""] * 99)  # it is busy no more
        await on.axis.stop()
        with pytest.raises(MoveCancelled):
            await move
        await asyncio.sleep(3.0)
        assert on.turns == pytest.approx(5.0, abs=0.01)
