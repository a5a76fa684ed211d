"""What happens to the event loop and to the computer, and what the bus makes of it."""

import asyncio
import logging
import time
from collections.abc import Callable

import pytest

from rs485bus import Bus, BusConfig, MksServo, Zlac8015d, open_bus
from rs485bus.bus.owner import Owner
from rs485bus.bus.runner import OwnerRunner
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.errors import NotSent
from rs485bus.sim import SimMks, SimUnit, SimZlac, VirtualLine
from rs485bus.transport import clock
from rs485bus.wire.frames import crc, read_holding
from rs485bus.wire.timing import LineSettings
from tests.integration.support import virtual


class Suspended:
    """A clock that goes on while the computer is suspended."""

    def __init__(self) -> None:
        self.asleep = 0.0

    def __call__(self, now: float) -> Callable[[], float]:
        loop = asyncio.get_running_loop()
        return lambda: loop.time() + self.asleep


def test_a_suspension_of_the_computer_is_an_unplugging(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    suspended = Suspended()
    monkeypatch.setattr(clock, "_running_on", suspended)

    @virtual
    async def main() -> None:
        sim = SimMks(1)
        bus = Bus(VirtualLine(sim), BusConfig())
        await bus.open()
        x = MksServo(bus, 1)
        x.enable()
        await x.run(60)
        suspended.asleep += 30.0
        with pytest.raises(NotSent, match=r"suspended for 30\.0 s"):
            await bus.unit(1).write_register(0x82, 5)
        assert "the computer was suspended for 30.0 s; trying to open it again" in caplog.text
        assert not bus.connected
        await asyncio.sleep(1.0)
        assert bus.connected
        assert not sim.moving(asyncio.get_running_loop().time())
        suspended.asleep += 0.05
        await asyncio.sleep(1.0)
        assert bus.connected
        await bus.aclose()

    main()


def test_the_clock_that_goes_on_stands_as_far_ahead_of_the_loops_as_it_did() -> None:
    async def main() -> None:
        suspensions = clock.Suspensions(asyncio.get_running_loop())
        ahead = suspensions.clock() - time.monotonic()
        assert ahead < suspensions.limit < ahead + 2 * clock.NOTICED or suspensions.limit == float("inf")

    asyncio.run(main())


def test_a_loop_that_was_blocked_is_logged_and_told_in_real_time(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        bus = Bus(VirtualLine(SimUnit(1, {0: 7})), BusConfig(silence=0.05))  # nothing goes out before it is blocked
        await bus.open()
        late: list[float] = []
        bus._pump.blocked = late.append
        reading = asyncio.create_task(bus.unit(1).read_holding_registers(0))
        await asyncio.sleep(0)
        time.sleep(0.4)  # noqa: ASYNC251
        await reading
        await bus.aclose()
        assert len(late) == 1
        assert late[0] > 0.25  # 0.4 s less what it would have slept anyway

    with caplog.at_level(logging.WARNING):
        asyncio.run(main())
    assert "the event loop did not run for 0." in caplog.text
    assert "asyncio.to_thread" in caplog.text


class Held:
    """A transport whose alarm goes off when a test says so."""

    name = "held"
    line = LineSettings(baudrate=115200)
    gateway = False
    unsent = 0
    lead = 0.0

    def alarm(self, callback: Callable[[], None]) -> "Held":
        self.goes_off = callback
        return self

    def set(self, when: float, *, likely: bool = True) -> None: ...

    def learn(self, late: float) -> None: ...

    def write(self, data: bytes) -> None: ...


def test_a_reply_that_came_while_the_loop_was_blocked_is_read_before_it_is_missed() -> None:
    async def main() -> None:
        loop, transport = asyncio.get_running_loop(), Held()
        owner = Owner(transport.line, BusConfig(echo=False, reply_timeout=0.01, retries=0), loop.time() - 1)
        runner = OwnerRunner(owner, transport, loop)  # type: ignore[arg-type]
        job = Job(read_holding(1, 0, 1))
        owner.submit(job, loop.time())
        runner.run()
        assert job.attempts == 1
        time.sleep(0.05)  # noqa: ASYNC251 - this is what it is about
        transport.goes_off()
        assert job.outcome is None
        body = bytes.fromhex("01 03 02 00 07")
        runner.received(body + crc(body))
        assert job.outcome is Outcome.REPLY
        await asyncio.sleep(0)

    asyncio.run(main())


def test_the_receive_latency_of_the_port_is_known_to_the_owner() -> None:
    @virtual
    async def main() -> None:
        line = VirtualLine(SimUnit(1, {0: 7}))
        line.receive_latency = 0.016  # type: ignore[attr-defined]
        bus = Bus(line, BusConfig())
        await bus.open()
        assert bus.owner.pair.latency == 0.016
        await bus.aclose()

    main()


@virtual
async def test_what_is_due_at_once_is_not_taken_for_a_blocked_loop(caplog: pytest.LogCaptureFixture) -> None:
    """A watchdog that was never fed is due at once: it was said that the loop did not run for inf s."""
    async with open_bus(VirtualLine(SimZlac(1))) as bus:
        base = Zlac8015d(bus, 1)
        await base.enable()
        async with bus.watchdog(base, timeout=0.5):
            await asyncio.sleep(1.0)
    assert caplog.text == ""
