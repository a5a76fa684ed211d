"""Nothing but the wire delays a set-point: not a lost frame, not an answer in doubt, not a full queue."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from rs485bus import BusConfig, MksServo, TlrStepper, open_bus
from rs485bus.bus.record import Record
from rs485bus.errors import BusError
from rs485bus.sim import Noise, SimMks, SimTlr, TlrMachine, VirtualLine
from tests.devices.stream_rig import ACCELERATION, FAMILIES, Make, now, one_live_tlr, one_tlr, rig
from tests.integration.support import virtual

_WRITES = (6, 16)


def lose(sim: Any, which: Callable[[bytes], bool], *, request: bool) -> None:
    """Lose the next frame of a kind, or the reply to it."""
    receive, left = sim.receive, [1]

    def lossy(frame: bytes, at: float) -> bytes | None:
        if not left[0] or not which(frame):
            return receive(frame, at)  # type: ignore[no-any-return]
        left[0] = 0
        if not request:
            receive(frame, at)
        return None

    sim.receive = lossy


def writes_to(register: int) -> Callable[[bytes], bool]:
    return lambda frame: frame[1] in _WRITES and int.from_bytes(frame[2:4], "big") == register


@FAMILIES
@pytest.mark.parametrize("request_lost", [True, False], ids=["request", "reply"])
@virtual
async def test_a_lost_frame_delays_one_set_point_and_the_next_one_takes_its_place(
    make: Make, request_lost: bool
) -> None:
    async with rig(make) as on, on.axis.stream(acceleration=ACCELERATION) as setpoint:
        for step in range(60):
            if step in (30, 45):
                lose(on.sim, lambda frame: frame[1] in _WRITES, request=request_lost)
            setpoint(200 + step)
            await asyncio.sleep(0.02)
            if step > 20:
                # A frame and what its answer is waited for; a TL-R then needs three more.
                assert setpoint.sent >= 200 + step - 2, step
            assert setpoint.delay < 0.02


@FAMILIES
@virtual
async def test_three_losses_in_a_row_hold_no_set_point_for_the_reply_timeout(make: Make) -> None:
    async with rig(make) as on, on.axis.stream(acceleration=ACCELERATION) as setpoint:
        for step in range(60):
            setpoint(200 + step)
            await asyncio.sleep(0.02)
            if step == 30:
                for _ in range(3):
                    lose(on.sim, lambda frame: frame[1] in _WRITES, request=True)
            if step > 33:
                assert setpoint.sent >= 200 + step - 3, step


@FAMILIES
@virtual
async def test_an_answer_in_doubt_holds_no_newer_set_point_back(make: Make) -> None:
    """It may be that to the frame before: that is a reason to say a speed once more, not to say nothing."""
    async with rig(make) as on, on.axis.stream(acceleration=ACCELERATION) as setpoint:
        delays = []
        for step in range(80):
            if step == 40:
                lose(on.sim, lambda frame: frame[1] in _WRITES, request=False)
            setpoint(200 + step)
            await asyncio.sleep(0.03)
            if step > 20:
                delays.append(setpoint.delay)
        assert max(delays) < 0.02


@pytest.mark.parametrize("make", [one_tlr, one_live_tlr])
@virtual
async def test_a_late_answer_to_an_older_jog_is_no_proof_that_the_newer_one_was_heard(make: Make) -> None:
    """Answers to writes of a block tell where, not what. The drive would turn at the old speed for ever."""
    async with rig(make) as on, on.axis.stream(timeout=30.0, acceleration=ACCELERATION) as setpoint:
        setpoint(100)
        await asyncio.sleep(0.5)
        receive, held = on.sim.receive, []

        def late(frame: bytes, at: float) -> bytes | None:
            """The answer to the first write of the jog comes as that to the second one, which is not heard."""
            if not writes_to(0x30)(frame) or len(held) > 1:
                return receive(frame, at)  # type: ignore[no-any-return]
            held.append(receive(frame, at) if not held else b"")
            return held[0] if len(held) > 1 else None

        on.sim.receive = late
        setpoint(150)
        await asyncio.sleep(0.002)
        setpoint(140)
        await asyncio.sleep(1.0)
        assert len(held) == 2
        assert on.rpm == pytest.approx(140, abs=3)


@virtual
async def test_the_newest_set_point_goes_into_the_frame_that_carries_it() -> None:
    """A TL-R that takes no speed while it jogs is told three frames; the speed is put in as late as possible."""
    async with rig(one_tlr) as on, on.axis.stream(timeout=30.0, acceleration=ACCELERATION) as setpoint:
        setpoint(200)
        await asyncio.sleep(0.5)
        seen: list[Record] = []
        on.axis.bus.subscribe(seen.append)
        setpoint(180)
        await asyncio.sleep(0.002)  # its control word is being cleared
        setpoint(190)
        await asyncio.sleep(0.05)
        carried = [record for record in seen if writes_to(0x30)(record.request)]
        assert [int.from_bytes(record.request[7:9], "big") for record in carried] == [190]


@virtual
async def test_a_newer_set_point_goes_before_the_trigger_of_one_that_is_on_the_wire() -> None:
    """Behind that trigger it would have to wait for two frames more."""
    async with rig(one_tlr) as on, on.axis.stream(timeout=30.0, acceleration=ACCELERATION) as setpoint:
        setpoint(200)
        await asyncio.sleep(0.5)
        seen: list[Record] = []
        on.axis.bus.subscribe(seen.append)
        receive, newer = on.sim.receive, [190.0]

        def heard(frame: bytes, at: float) -> bytes | None:
            if writes_to(0x30)(frame) and newer:
                setpoint(newer.pop())  # before the drive has answered
            return receive(frame, at)  # type: ignore[no-any-return]

        on.sim.receive = heard
        setpoint(180)
        await asyncio.sleep(0.05)
        writes = [record.request for record in seen if record.request[1] in _WRITES]
        assert [frame[2:4].hex() for frame in writes] == ["004e", "0030", "0030", "004e"]
        assert [int.from_bytes(frame[7:9], "big") for frame in writes[1:3]] == [180, 190]
        assert on.rpm == pytest.approx(190, abs=3)


@virtual
async def test_a_drive_that_takes_no_blocks_is_streamed_by_single_writes() -> None:
    sim = SimTlr(1, machine=TlrMachine(origin=None))
    async with open_bus(VirtualLine(sim)) as bus:
        axis = TlrStepper(bus, 1, block_writes=False)
        await axis.enable()
        seen: list[Record] = []
        bus.subscribe(seen.append)
        async with axis.stream(acceleration=ACCELERATION) as setpoint:
            for _ in range(20):
                setpoint(200)
                await asyncio.sleep(0.05)
            assert sim.rpm(now()) == pytest.approx(200)
        assert 16 not in {record.request[1] for record in seen}


@FAMILIES
@virtual
async def test_a_queue_full_of_others_keeps_no_set_point_from_the_wire(make: Make) -> None:
    sim, axis_of = make()
    async with open_bus(VirtualLine(sim, SimMks(9)), config=BusConfig(max_queued=20)) as bus:
        axis, other = axis_of(bus), MksServo(bus, 9)
        await axis.enable()

        async def flood() -> None:
            while True:
                with suppress(BusError):
                    await other.position()
                await asyncio.sleep(0)

        async with axis.stream(acceleration=ACCELERATION) as setpoint:
            flooding = [asyncio.create_task(flood()) for _ in range(40)]
            for step in range(60):
                setpoint(100 + step)
                await asyncio.sleep(0.02)
                if step > 20:
                    assert setpoint.sent >= 100 + step - 3
            for task in flooding:
                task.cancel()


@FAMILIES
@virtual
async def test_a_drive_that_has_become_slow_is_waited_for_and_told_no_less(make: Make) -> None:
    """It answers in 30 ms from now on. What it does is known again, and the stream goes on."""
    async with rig(make) as on, on.axis.stream(acceleration=ACCELERATION) as setpoint:
        for step in range(150):
            setpoint(100 + step)
            await asyncio.sleep(0.02)
            if step == 50:
                on.sim.turnaround = 0.03
        assert on.rpm == pytest.approx(249, abs=15)
        for _ in range(50):
            setpoint(250)
            await asyncio.sleep(0.02)
        assert on.rpm == pytest.approx(250, abs=3)


@FAMILIES
@virtual
async def test_a_line_that_loses_three_in_ten_frames_is_streamed_on(make: Make) -> None:
    noise = Noise(lost_request=0.15, lost_reply=0.15)
    async with rig(make, noise=noise, seed=5) as on, on.axis.stream(timeout=0.5, acceleration=ACCELERATION) as setpoint:
        for step in range(300):
            setpoint(200 + step % 5)
            await asyncio.sleep(0.02)
        assert on.rpm == pytest.approx(202, abs=6)


@FAMILIES
@pytest.mark.parametrize("emergency", [False, True], ids=["stop", "emergency stop"])
@virtual
async def test_nothing_of_a_stream_follows_a_stop_whenever_that_comes(make: Make, emergency: bool) -> None:
    """Also where the stop cuts a set-point on the wire: one that is told instead would be newer than the stop."""
    for phase in range(12):
        async with rig(make) as on:
            with suppress(BusError):
                async with on.axis.stream(acceleration=5000.0) as setpoint:
                    for step in range(25):
                        setpoint(100 + step)
                        await asyncio.sleep(0.02)
                    for _ in range(4):  # the last one is waited for as long as the drive may take
                        lose(on.sim, lambda frame: frame[1] in _WRITES, request=True)
                    for step in range(phase + 2):
                        setpoint(130 + step)
                        await asyncio.sleep(0.004)
                    await (on.axis.emergency_stop() if emergency else on.axis.stop())
                    place = on.sim.shaft(now())
                    await asyncio.sleep(0.5)
                    assert on.sim.shaft(now()) == place, phase
