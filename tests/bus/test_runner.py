"""What happens to the event loop and to the computer, and what the bus makes of it."""

import asyncio
import logging
import time
from collections.abc import Callable

import pytest

from rs485bus import Bus, BusConfig, MksServo
from rs485bus.errors import NotSent
from rs485bus.sim import SimMks, SimUnit, VirtualLine
from rs485bus.transport import clock
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
        bus = Bus(VirtualLine(SimUnit(1, {0: 7})), BusConfig())
        await bus.open()
        late: list[float] = []
        bus._pump.blocked = late.append
        reading = asyncio.create_task(bus.unit(1).read_holding_registers(0))
        await asyncio.sleep(0)
        time.sleep(0.4)  # noqa: ASYNC251
        await reading
        await bus.aclose()
        assert len(late) == 1
        assert 0.25 < late[0] < 0.5  # 0.4 s less what it would have slept anyway

    with caplog.at_level(logging.WARNING):
        asyncio.run(main())
    assert "the event loop did not run for 0." in caplog.text
    assert "asyncio.to_thread" in caplog.text
