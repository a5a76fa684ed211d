"""Whatever stands around the replies: commands, watchdog blocks and closing end, and no reads go out for ever."""

import asyncio
from collections.abc import Callable

import pytest

from rs485bus import BusConfig, MksServo, open_bus
from rs485bus.errors import NotSent, OutcomeUnknown
from rs485bus.sim import Noise, SimMks, SimUnit, VirtualLine
from tests.integration.support import virtual


class DirtyMks(SimMks):
    """A drive on a pair without bias: bytes come before and behind its replies."""

    before = b""
    behind = b""

    def receive(self, frame: bytes, now: float) -> bytes | None:
        reply = super().receive(frame, now)
        return None if reply is None else self.before + reply + self.behind


class Before(DirtyMks):
    before = b"\0"


class Behind(DirtyMks):
    behind = b"\xff"


def dirty_before() -> VirtualLine:
    return VirtualLine(Before(1))


def dirty_behind() -> VirtualLine:
    return VirtualLine(Behind(1))


def echoing() -> VirtualLine:
    return VirtualLine(SimMks(1), noise=Noise(echo=True))


def echoing_too_late() -> VirtualLine:
    line = echoing()
    arrive = line.pair._arrive
    line.pair._arrive = lambda data, start, talk: arrive(data if talk else data[1:], start, talk)  # type: ignore[method-assign]
    return line


LINES = [dirty_before, dirty_behind, echoing, echoing_too_late]


@pytest.mark.parametrize("made", LINES)
@virtual
async def test_an_axis_is_enabled_moved_guarded_and_left(made: Callable[[], VirtualLine]) -> None:
    line = made()
    (sim,) = line.pair.devices
    assert isinstance(sim, SimMks)
    async with asyncio.timeout(30), open_bus(line) as bus:
        x = MksServo(bus, 1)
        async with bus.watchdog(x, timeout=1.0):
            await x.enable()
            assert sim.watchdog_ms == 1000
            await x.move_to(0.5)
    assert sim.watchdog_ms == 0
    assert not sim.moving(asyncio.get_running_loop().time())


@pytest.mark.parametrize("echo", [True, False])
@virtual
async def test_where_nobody_is_there_all_ends_and_can_be_cancelled(echo: bool) -> None:
    line = VirtualLine(noise=Noise(echo=echo))
    bus = await open_bus(line)
    async with asyncio.timeout(60):
        with pytest.raises(OutcomeUnknown):
            await bus.unit(1).write_register(5, 1, timeout=3.0)
        assert line.pair.frames <= 7
        entering = asyncio.create_task(bus.watchdog(MksServo(bus, 2), timeout=1.0).__aenter__())
        await asyncio.sleep(0.15)
        entering.cancel()
        await asyncio.wait([entering])
        frames = line.pair.frames
        await asyncio.sleep(10.0)
        assert line.pair.frames - frames < 300  # stops, of a drive that cannot be seen standing
        await bus.aclose()
    assert line.pair.early_frames == 0


@virtual
async def test_a_write_that_must_wait_too_long_says_that_no_read_was_answered() -> None:
    async with open_bus(VirtualLine(), config=BusConfig(reply_timeout=2.0)) as bus:
        with pytest.raises(NotSent, match="before it was known whether the adapter returns what is sent"):
            await bus.unit(1).write_register(5, 1, timeout=3.0)


@virtual
async def test_an_echo_that_a_first_read_did_not_show_makes_no_write_done() -> None:
    """The first read is to a unit that is not there."""
    async with open_bus(VirtualLine(SimUnit(7, {0: 0}), noise=Noise(echo=True))) as bus:
        for unit in (1, 2):
            with pytest.raises(OutcomeUnknown):
                await bus.unit(unit).write_register(5, 1)
        await bus.unit(7).write_register(0, 5)
        assert bus.stats.echo is True
