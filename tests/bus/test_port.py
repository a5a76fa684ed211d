"""A port that is lost: when it is opened again, what the log says of it, and what becomes of what is on its way."""

import asyncio
import logging
from collections.abc import Callable

import pytest

from rs485bus import Bus, BusConfig, MksServo
from rs485bus.bus.failure import failure
from rs485bus.bus.schedule.job import Job, Outcome, Reason
from rs485bus.errors import NoReply, NotSent, OutcomeUnknown, PortNotFound
from rs485bus.sim import SimMks, SimUnit, VirtualClockLoop, VirtualLine
from rs485bus.transport.interface import Sink
from rs485bus.wire.frames import read_holding
from tests.integration.support import virtual

HINT = "Close the other client."


class Wayward(VirtualLine):
    """A line whose other end does with a new connection what it is told; nothing when that is used up.

    "hang up" at once, "refuse" it, hang up while it is "opening", or raise what is given.
    """

    name = "gateway"
    hang_up_hint = HINT

    def __init__(self, *script: str | Exception, forever: bool = False) -> None:
        super().__init__(SimUnit(1, {0: 7}))
        self.script = list(script)
        self.forever = forever
        self.opened: list[float] = []

    async def open(self, sink: Sink) -> None:
        self.opened.append(asyncio.get_running_loop().time())
        step = self.script[0] if self.script else ""
        if not self.forever and self.script:
            self.script.pop(0)
        if isinstance(step, Exception):
            raise step
        if step == "refuse":
            raise PortNotFound("refused")
        await super().open(sink)
        if step == "hang up":
            self.abort()
        if step == "opening":
            self._sink = None
            sink.lost(None)


def pauses(line: Wayward) -> list[float]:
    return [round(after - before, 3) for before, after in zip(line.opened, line.opened[1:], strict=False)]


async def opened(line: VirtualLine, **options: object) -> Bus:
    bus = Bus(line, BusConfig(**options))  # type: ignore[arg-type]
    await bus.open()
    return bus


def warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


@pytest.mark.parametrize("how", ["hang up", "opening"])
@virtual
async def test_a_gateway_that_hangs_up_at_once_is_asked_less_and_less_often(how: str) -> None:
    line = Wayward(how, forever=True)
    bus = await opened(line)
    await asyncio.sleep(30)
    assert pauses(line)[:8] == [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0]
    await bus.aclose()


def test_a_gateway_that_hangs_up_at_once_is_logged_once_a_minute_and_with_what_to_do(
    caplog: pytest.LogCaptureFixture,
) -> None:
    @virtual
    async def main() -> None:
        line = Wayward("hang up", forever=True)
        bus = await opened(line)
        await asyncio.sleep(59)
        first = warnings(caplog)
        assert first == [f"gateway was lost; trying to open it again. {HINT}"]
        await asyncio.sleep(59)
        assert len(warnings(caplog)) == 2
        assert "gateway was lost 17 times in the last 61 s" in warnings(caplog)[1]
        line.script.clear()
        await asyncio.sleep(20)
        assert warnings(caplog)[2:] == ["gateway is open again"]
        await bus.aclose()

    main()


@pytest.mark.parametrize("how", ["hang up", "refuse", "opening"])
@virtual
async def test_a_read_waits_30_s_for_a_port_that_never_stays_and_its_error_says_what_to_do(how: str) -> None:
    line = Wayward("", how, forever=False)
    line.script += [how] * 100
    bus = await opened(line)
    line.abort()
    await asyncio.sleep(0.01)
    begun = asyncio.get_running_loop().time()
    with pytest.raises(NotSent, match="refused" if how == "refuse" else HINT.rstrip(".")):
        await bus.unit(1).read_holding_registers(0)
    assert asyncio.get_running_loop().time() - begun == pytest.approx(30.0, abs=0.1)
    begun = asyncio.get_running_loop().time()
    await bus.aclose()
    assert asyncio.get_running_loop().time() == begun


def test_a_line_that_is_never_quiet_names_the_program_that_writes_to_it_too() -> None:
    job = Job(read_holding(1, 0, 1))
    job.outcome, job.reason = Outcome.NOT_SENT, Reason.LINE_BUSY
    assert "cat (process 7) has /dev/ttyUSB0 open, too: function 3" in str(
        failure(job, [], advice="cat (process 7) has /dev/ttyUSB0 open, too.")
    )


@virtual
async def test_an_answer_makes_the_pauses_short_again() -> None:
    line = Wayward(*["hang up"] * 6)
    bus = await opened(line)
    assert await bus.unit(1).read_holding_registers(0) == [7]
    assert len(line.opened) == 7
    line.abort()
    await asyncio.sleep(0.15)
    assert pauses(line)[-1] == pytest.approx(0.1, abs=0.01)
    await bus.aclose()


@virtual
async def test_a_connection_that_stood_for_long_without_a_question_makes_them_short_again_too() -> None:
    line = Wayward(*["hang up"] * 6)
    bus = await opened(line)
    await asyncio.sleep(60)
    line.abort()
    await asyncio.sleep(0.15)
    assert line.opened[-1] == pytest.approx(asyncio.get_running_loop().time() - 0.05, abs=0.001)
    await bus.aclose()


@virtual
async def test_a_port_that_cannot_be_opened_is_tried_with_growing_pauses_and_used_as_soon_as_it_is_there() -> None:
    line = Wayward("", *["refuse"] * 4)
    bus = await opened(line)
    line.abort()
    assert await bus.unit(1).read_holding_registers(0) == [7]
    assert pauses(line)[1:] == [0.2, 0.4, 0.8, 1.6]
    await bus.aclose()


@virtual
async def test_a_connection_that_ends_while_it_is_opened_is_no_port() -> None:
    line = Wayward("", "opening")
    bus = await opened(line)
    line.abort()
    await asyncio.sleep(0.25)
    assert not bus.connected
    await asyncio.sleep(0.2)
    assert bus.connected
    assert len(line.opened) == 3
    await bus.aclose()


def test_a_transport_that_raises_anything_is_opened_again(caplog: pytest.LogCaptureFixture) -> None:
    @virtual
    async def main() -> None:
        line = Wayward("", *[RuntimeError("no such thing")] * 3)
        bus = await opened(line)
        line.abort()
        assert await bus.unit(1).read_holding_registers(0) == [7]
        assert sum("could not be opened; trying again" in said for said in warnings(caplog)) == 1
        await bus.aclose()

    main()


def test_a_port_is_opened_again_and_the_motor_stopped_while_every_task_is_cancelled_at_the_end_of_the_program() -> None:
    sim = SimMks(1)
    line = VirtualLine(sim)

    async def main() -> float:
        x = MksServo(await opened(line), 1)
        x.enable()
        await x.run(60)
        line.unplug()
        loop = asyncio.get_running_loop()
        loop.call_later(1.0, line.plug)
        return loop.time()

    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        begun = runner.run(main())
        loop = runner.get_loop()
    assert not sim.moving(loop.time())
    assert loop.time() < begun + 3


@virtual
async def test_a_cancelled_attempt_to_open_the_port_is_made_again() -> None:
    line = Wayward("", "refuse")
    bus = await opened(line)
    line.abort()
    for _ in range(200):
        await asyncio.sleep(0.001)
        attempts = [task for task in asyncio.all_tasks() if "reopening" in task.get_name()]
        for task in attempts:
            task.cancel()
    await asyncio.sleep(1)
    assert bus.connected
    await bus.aclose()


class Clogged(VirtualLine):
    """A line that keeps what is sent from a moment on."""

    clogged = False

    def __init__(self) -> None:
        super().__init__(SimUnit(1, {0: 7}))
        self.kept = b""

    @property
    def unsent(self) -> int:
        return len(self.kept)

    def write(self, data: bytes) -> None:
        if self.clogged:
            self.kept += data
        else:
            super().write(data)

    def abort(self) -> None:
        self.kept = b""
        self.clogged = False
        super().abort()


async def _broadcast(bus: Bus) -> None:
    await bus.broadcast.write_register(0, 1)


async def _write(bus: Bus) -> None:
    await bus.unit(1).write_register(0, 1)


@pytest.mark.parametrize("send", [_broadcast, _write])
@virtual
async def test_what_could_not_be_sent_in_its_time_is_dropped_with_the_connection(
    send: Callable[[Bus], object],
) -> None:
    line = Clogged()
    bus = await opened(line)
    assert await bus.unit(1).read_holding_registers(0) == [7]
    line.clogged = True
    with pytest.raises(OutcomeUnknown, match="port was lost"):
        await send(bus)  # type: ignore[misc]
    assert not bus.connected
    assert await bus.unit(1).read_holding_registers(0) == [7]
    await bus.aclose()


@virtual
async def test_a_broadcast_whose_port_is_lost_in_its_turnaround_is_unknown() -> None:
    line = VirtualLine(SimUnit(1, {0: 7}))
    bus = await opened(line)
    assert await bus.unit(1).read_holding_registers(0) == [7]
    asyncio.get_running_loop().call_later(0.05, line.abort)
    with pytest.raises(OutcomeUnknown, match="port was lost"):
        await bus.broadcast.write_register(0, 1)
    await bus.aclose()


@virtual
async def test_a_request_that_was_on_the_wire_when_the_port_was_lost_says_why() -> None:
    line = VirtualLine(SimUnit(1, {0: 7}))
    bus = await opened(line)
    asyncio.get_running_loop().call_later(0.05, bus._port.drop, "somebody pulled the plug")
    with pytest.raises(
        NoReply, match=r"The port was lost meanwhile\. virtual line was lost: somebody pulled the plug\."
    ):
        await bus.unit(2).read_holding_registers(0)
    await bus.aclose()
