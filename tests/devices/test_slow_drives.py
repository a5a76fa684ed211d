"""Drives that answer slowly: looks at what moves fill the wire, and yet nobody waits for ever."""

import asyncio
import functools
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from rs485bus import AxisGroup, Bus, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.devices.mks import Status
from rs485bus.errors import MotionError
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine
from rs485bus.sim.mks_quirks import Quirks
from rs485bus.wire.frames import crc
from tests.devices.stream_rig import now
from tests.devices.test_setpoints_on_the_wire import lose, writes_to
from tests.integration.support import virtual

SLOW = (0.03, 0.06, 0.09)


@asynccontextmanager
async def slow(
    turnaround: float, drives: int = 2, baudrate: int = 115200
) -> AsyncIterator[tuple[Bus, list[MksServo], list[SimMks]]]:
    """Drives that take so many seconds before they answer, enabled."""
    sims = [SimMks(address) for address in range(1, drives + 1)]
    async with open_bus(VirtualLine(*sims, baudrate=baudrate, turnaround=turnaround)) as bus:
        axes = [MksServo(bus, sim.address) for sim in sims]
        await asyncio.gather(*(axis.enable().wait() for axis in axes))
        yield bus, axes, sims


@pytest.mark.parametrize("turnaround", SLOW)
@virtual
async def test_streams_of_slow_drives_are_told_each_change_and_end(turnaround: float) -> None:
    async with slow(turnaround) as (_, axes, sims):
        async with asyncio.timeout(20), AxisGroup(x=axes[0], y=axes[1]).stream() as setpoint:
            for rpm in (60, -60, 90):
                for _ in range(30):
                    setpoint(x=rpm, y=rpm)
                    before = [sim.shaft(now()) for sim in sims]
                    await asyncio.sleep(0.05)
                turned = [sim.shaft(now()) - place for sim, place in zip(sims, before, strict=True)]
                assert turned == [pytest.approx(rpm / 60 * 0.05, rel=0.05)] * 2
        assert not any(sim.moving(now()) for sim in sims)


@pytest.mark.parametrize("turnaround", SLOW)
@virtual
async def test_a_set_point_that_is_too_old_stops_slow_drives_too(turnaround: float) -> None:
    async with slow(turnaround) as (_, axes, sims), AxisGroup(x=axes[0], y=axes[1]).stream() as setpoint:
        for _ in range(10):
            setpoint(x=60, y=60)
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.25 + 6 * turnaround + 0.3)
        assert not any(sim.moving(now()) for sim in sims)


@virtual
async def test_questions_and_commands_to_others_are_answered_while_looks_at_slow_drives_fill_the_wire() -> None:
    async with slow(0.06, drives=3) as (bus, axes, _), asyncio.timeout(40):
        async with AxisGroup(x=axes[0], y=axes[1]).stream() as setpoint:
            took = []
            for _ in range(12):
                setpoint(x=60, y=60)
                begun = now()
                await bus.unit(3).read_input_registers(0x30, 3)
                setpoint(x=70, y=70)
                await axes[2].enable()
                took.append(now() - begun)
        assert max(took) < 2.5


@virtual
async def test_a_group_s_stream_and_a_command_of_both_wheels_wait_for_each_other_in_one_order() -> None:
    """The stream begins on one axis after the other; what both wheels do together must not come in between."""
    sims: tuple[Any, ...] = (SimZlac(1), SimMks(2))
    async with open_bus(VirtualLine(*sims)) as bus:
        base, x = Zlac8015d(bus, 1), MksServo(bus, 2)
        base.enable()
        x.enable()
        group = AxisGroup(left=base.left, right=base.right, x=x)

        async def stream() -> None:
            async with group.stream() as setpoint:
                setpoint(left=30, right=30, x=30)
                await asyncio.sleep(0.2)

        streaming = asyncio.ensure_future(stream())
        for _ in range(8):
            await asyncio.sleep(0.01)
            base.clear_fault()
        async with asyncio.timeout(20):
            await streaming
            await bus.drain()


@virtual
async def test_streams_of_the_same_axes_named_in_another_order_follow_each_other() -> None:
    async with slow(0.002) as (_, axes, _), asyncio.timeout(20):
        groups = AxisGroup(x=axes[0], y=axes[1]), AxisGroup(y=axes[1], x=axes[0])

        async def stream(group: AxisGroup) -> None:
            async with group.stream() as setpoint:
                setpoint(x=30, y=30)
                await asyncio.sleep(0.2)

        await asyncio.gather(*map(stream, groups))


@virtual
async def test_a_run_whose_answer_was_lost_is_settled_though_looks_are_far_apart() -> None:
    """It turns, and no two positions of it are closer together than what a standing axis may be trusted for."""
    async with slow(0.09, drives=3) as (_, axes, sims), asyncio.timeout(30):
        lose(sims[0], writes_to(0xF6), request=False)
        async with AxisGroup(x=axes[1], y=axes[2]).stream() as setpoint:
            run = axes[0].run(120)
            while not run.done():
                setpoint(x=60, y=60)
                await asyncio.sleep(0.1)
        await run
        assert sims[0].moving(now())


@virtual
async def test_a_group_s_stream_on_one_wheel_is_not_in_the_way_of_a_move_that_the_other_one_has_before_it() -> None:
    async with open_bus(VirtualLine(SimZlac(1))) as bus, asyncio.timeout(20):
        base = Zlac8015d(bus, 1)
        base.left.enable()
        base.right.enable()
        move = base.right.move_by(0.5)
        async with AxisGroup(left=base.left, right=base.right).stream() as setpoint:
            setpoint(left=30, right=30)
            await asyncio.sleep(0.2)
        assert await move == pytest.approx(0.5, abs=0.01)


@virtual
async def test_a_target_that_is_changed_while_the_move_arrives_is_gone_to_or_was_not_changed() -> None:
    made = 0
    for step in range(16):
        async with slow(0.085, drives=1) as (_, (axis,), sims), asyncio.timeout(30):
            move = axis.move_to(0.5, rpm=60)
            await asyncio.sleep(0.45 + 0.02 * step)
            try:
                await axis.retarget(0.1, rpm=30)
                made += 1
            except MotionError:
                wanted = 0.5
            else:
                wanted = 0.1
            assert await move == pytest.approx(wanted, abs=0.01), step
            assert sims[0].shaft(now()) == pytest.approx(wanted, abs=0.01), step
    assert 0 < made < 16


@pytest.mark.parametrize("turnaround", [0.008, 0.012, 0.016, 0.03])
@virtual
async def test_no_stop_is_sent_into_the_answer_to_the_one_before_it(turnaround: float) -> None:
    """At 9600 bit/s a stop takes longer than what is left of the time that the drive before it takes to answer."""
    async with slow(turnaround, drives=3, baudrate=9600) as (_, axes, sims):
        await asyncio.gather(*(axis.run(120).wait() for axis in axes))
        heard: dict[int, float] = {}

        def hears(sim: SimMks, receive: Any, frame: bytes, at: float) -> bytes | None:
            if frame[0] == sim.address and writes_to(0xF6)(frame):
                heard.setdefault(sim.address, at)
            return receive(frame, at)  # type: ignore[no-any-return]

        for sim in sims:
            sim.receive = functools.partial(hears, sim, sim.receive)  # type: ignore[method-assign]
        begun = now()
        await asyncio.gather(*(axis.stop().wait() for axis in axes))
        assert sorted(heard) == [1, 2, 3]
        assert max(heard.values()) - begun < 4 * (turnaround + 0.03)


@virtual
async def test_late_answers_to_stops_are_no_noise_and_stops_to_one_drive_keep_no_other_from_being_looked_at() -> None:
    """They come while the next stop goes out: told again and again, one that is slow would have the pair for itself."""
    for after in range(20):
        tlr, zlac = SimTlr(1), SimZlac(2)
        tlr.baudrate = 9600
        async with open_bus(VirtualLine(tlr, zlac, baudrate=9600, turnaround=0.085)) as bus, asyncio.timeout(20):
            y, base = TlrStepper(bus, 1), Zlac8015d(bus, 2)
            for axis in (y, base.left, base.right):
                axis.enable()
            await asyncio.sleep(0.2 + 0.01 * after)
            begun = now()
            await asyncio.gather(*(axis.stop().wait() for axis in (y, base.left, base.right)))
            assert now() - begun < 2.0, after


@pytest.mark.parametrize("turnaround", [0.01, 0.07])
@pytest.mark.parametrize("baudrate", [9600, 115200])
@virtual
async def test_a_status_that_lies_confirms_no_stop_however_long_an_answer_takes(
    baudrate: int, turnaround: float
) -> None:
    """They acknowledge the stop, say at once that they stand, and slow down for 1.5 s."""
    mks, tlr = SimMks(1, quirks=Quirks(lying=Status.STOPPED)), SimTlr(2)
    mks.baudrate = tlr.baudrate = baudrate
    mks_hears, tlr_hears = mks.receive, tlr.receive
    stops: list[bytes] = []

    def mks_coasts(frame: bytes, at: float) -> bytes | None:
        if frame[1:4] != bytes((6, 0, 0xF7)):
            return mks_hears(frame, at)
        body = bytes.fromhex("011000F6000204006E0000")
        mks_hears(body + crc(body), at)
        return frame

    def tlr_coasts(frame: bytes, at: float) -> bytes | None:
        if frame[:4] == bytes((2, 6, 0, 0x4E)) and frame[5] & 0x60:
            asyncio.get_running_loop().call_later(1.5, lambda: tlr_hears(frame, now()))
            stops.append(frame)
            return frame
        answer = tlr_hears(frame, at)
        if frame[:4] != bytes((2, 3, 0, 0x04)) or answer is None or not stops:
            return answer
        body = answer[:4] + bytes((answer[4] & ~4,)) + answer[5:15] + bytes(len(answer[15:-2]))
        return body + crc(body)

    mks.receive, tlr.receive = mks_coasts, tlr_coasts  # type: ignore[method-assign]
    async with open_bus(VirtualLine(mks, tlr, baudrate=baudrate, turnaround=turnaround)) as bus:
        axes = MksServo(bus, 1), TlrStepper(bus, 2)
        for axis in axes:
            await axis.enable()
            await axis.run(300)
        report = await bus.emergency_stop()
        turning = {sim.address for sim in (mks, tlr) if sim.moving(now())}
        assert turning.isdisjoint(halted.address for halted in report.devices if halted.standing)
        await asyncio.sleep(2.0)
