"""What goes wrong ends in the stated way, before anything moves where that can be, and leaves the bus usable."""

import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from rs485bus import Bus, BusConfig, MksServo, open_bus
from rs485bus.errors import (
    AddressInUse,
    BroadcastConflict,
    BusClosed,
    DeviceOffline,
    DeviceRefused,
    EmergencyStopped,
    LimitExceeded,
    MotionError,
    NoReply,
    NotEnabled,
    NotSent,
    OutcomeUnknown,
    PortNotFound,
    QueueFull,
    RearmRequired,
    WrongThread,
)
from rs485bus.sim import SimUnit, VirtualClockLoop, VirtualLine
from rs485bus.wire.registers import Repeat
from tests.integration.support import bus_on, plant, virtual


async def usable(x: MksServo) -> None:
    """The bus and the axis still work."""
    await x.drain()
    await x.enable()
    before = await x.position()
    assert await x.move_by(0.5) == pytest.approx(before + 0.5)


@virtual
async def test_an_address_out_of_range() -> None:
    async with bus_on(plant()) as (bus, (x,)):
        for address in (-1, 0, 248):
            with pytest.raises(ValueError, match=r"outside 1\.\.247"):
                bus.unit(address)
            with pytest.raises(ValueError, match=r"outside 1\.\.247"):
                MksServo(bus, address)
        await usable(x)


@virtual
async def test_a_speed_above_the_maximum_of_the_mode() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        with pytest.raises(LimitExceeded, match=r"rpm 3001 is outside .* above 0, up to 3000 \(mode SR_VFOC"):
            x.move_to(1.0, rpm=3001)
        with pytest.raises(LimitExceeded):
            x.run(-3001)
        assert made.line.pair.frames == 0
        await usable(x)


@virtual
async def test_a_move_outside_the_limits() -> None:
    made = plant()
    async with open_bus(made.line) as bus:
        x = MksServo(bus, 1, limits=(0.0, 5.0), units_per_turn=2.0)
        with pytest.raises(LimitExceeded, match=r"position 5\.1 is outside its limits 0\.\.5"):
            x.move_to(5.1)
        x.enable()
        x.set_zero()
        x.move_to(4.0)
        with pytest.raises(LimitExceeded, match="position 6 is outside"):
            x.move_by(2.0)
        assert made.sims[0].moves == 0
        await usable(x)


@virtual
async def test_a_relative_move_whose_end_was_not_known_when_it_was_queued_is_checked_before_it_is_sent() -> None:
    made = plant()
    async with open_bus(made.line) as bus:
        x = MksServo(bus, 1, limits=(-1.0, 1.0))
        x.enable()
        with pytest.raises(LimitExceeded):
            await x.move_by(1.5)
        assert made.sims[0].moves == 0
        await usable(x)


@virtual
async def test_a_drive_that_is_not_there() -> None:
    made = plant()
    async with bus_on(made) as (bus, (x,)):
        absent = MksServo(bus, 99)
        with pytest.raises(NoReply, match="sent 3 times"):
            await absent.position()
        for _ in range(2):
            with pytest.raises(NoReply):
                await absent.position()
        with pytest.raises(DeviceOffline, match="has stopped answering"):
            await absent.position()
        await usable(x)


@virtual
async def test_a_refused_move() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        x.enable()
        await x.move_to(1.0)
        made.sims[0].settings[0x82] = 2  # somebody set a pulse mode at its display
        with pytest.raises(DeviceRefused, match="Refused, in its reply"):
            await x.move_to(2.0)
        made.sims[0].settings[0x82] = 5
        await usable(x)


@virtual
async def test_a_stop_of_a_standing_motor_is_no_error() -> None:
    async with bus_on(plant()) as (_, (x,)):
        await x.stop()
        await x.emergency_stop()
        await usable(x)


@virtual
async def test_a_caller_cancelled_while_its_request_is_on_the_wire() -> None:
    made = plant()
    async with bus_on(made) as (bus, (x,)):
        await x.position()
        asking = asyncio.create_task(x.position())
        await asyncio.sleep(0.0025)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        await usable(x)
        assert made.line.pair.early_frames == 0
        assert bus.stats.units[1].timeouts == 0


def test_a_port_that_does_not_exist() -> None:
    async def main() -> None:
        with pytest.raises(PortNotFound, match=r"There is no port /dev/ttyNOPE\. Ports of this machine: "):
            async with open_bus("/dev/ttyNOPE", baudrate=38400):
                pass

    asyncio.run(main())


def test_a_serial_port_without_a_baud_rate() -> None:
    with pytest.raises(ValueError, match="MKS drives are shipped at 38400"):
        open_bus("/dev/ttyUSB0")


def test_a_gateway_without_a_port() -> None:
    with pytest.raises(ValueError, match="socket://192"):
        open_bus("socket://gateway")


@pytest.mark.parametrize(
    "settings",
    [
        {"reply_timeout": 0},
        {"retries": -1},
        {"echo": "yes"},
        {"late_reply_window": 0.0},
        {"offline_after": 0},
        {"reopen_min": 7.0},
    ],
)
def test_a_setting_out_of_range(settings: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(settings))):
        BusConfig(**settings)  # type: ignore[arg-type] # the point of the test


@virtual
async def test_a_second_facade_for_an_address() -> None:
    async with bus_on(plant()) as (bus, (x,)):
        with pytest.raises(AddressInUse, match="Address 1 has a facade already"):
            MksServo(bus, 1)
        await usable(x)


@virtual
async def test_a_call_from_a_foreign_thread() -> None:
    async with bus_on(plant()) as (_, (x,)):
        errors: list[BaseException] = []

        def call() -> None:
            try:
                x.stop()
            except WrongThread as error:
                errors.append(error)

        thread = threading.Thread(target=call)
        thread.start()
        thread.join()
        assert "call_soon_threadsafe" in str(errors[0])
        await usable(x)


@virtual
async def test_what_is_awaited_in_a_foreign_thread_says_how_it_is_done_from_there() -> None:
    async with bus_on(plant()) as (bus, (x,)):
        errors: list[BaseException] = []

        def call() -> None:
            for ask in (bus.aclose, bus.drain, x.position):
                try:
                    asyncio.run(ask())
                except WrongThread as error:
                    errors.append(error)

        thread = threading.Thread(target=call)
        thread.start()
        thread.join(10.0)
        assert len(errors) == 3
        assert all("asyncio.run_coroutine_threadsafe(bus.aclose(), loop)" in str(error) for error in errors)
        await usable(x)


def test_a_bus_whose_event_loop_was_closed_says_so_and_may_be_closed_again() -> None:
    async def left_open() -> tuple[Bus, MksServo]:
        bus = await open_bus(plant().line)
        return bus, MksServo(bus, 1)

    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        bus, x = runner.run(left_open())
    for verb in (x.stop, bus.emergency_stop, lambda: x.move_to(1.0)):
        with pytest.raises(BusClosed, match=r"event loop of the bus was closed, .* Open the bus anew"):
            verb()
    with pytest.raises(BusClosed, match="Open the bus anew"):
        asyncio.run(x.position())
    asyncio.run(bus.aclose())  # it was, when its loop ended


@virtual
async def test_more_than_64_commands_on_an_axis() -> None:
    async with bus_on(plant()) as (_, (x,)):
        await x.enable()
        moves = [x.move_by(0.001) for _ in range(64)]
        with pytest.raises(QueueFull, match="64 commands wait on MKS 1"):
            x.move_by(0.001)
        await asyncio.gather(*moves)


@virtual
async def test_a_motor_that_is_not_enabled() -> None:
    made = plant(enabled_at_power_on=False)
    async with bus_on(made) as (_, (x,)):
        with pytest.raises(NotEnabled, match=r"enable\(\) it first"):
            await x.move_to(1.0)
        assert made.sims[0].moves == 0
        await usable(x)


@virtual
async def test_a_failed_move_cancels_what_is_behind_it_and_must_be_seen() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        await x.enable()
        made.sims[0].settings[0x82] = 2
        failing, behind = x.move_to(1.0), x.move_to(2.0)
        await asyncio.sleep(1.0)
        with pytest.raises(Exception, match="nobody has seen it"):
            x.move_to(3.0)
        assert behind.state.value == "cancelled"
        with pytest.raises(DeviceRefused):
            await failing
        made.sims[0].settings[0x82] = 5
        assert await x.move_to(3.0) == 3.0


@virtual
async def test_moves_while_the_bus_is_latched_and_after() -> None:
    made = plant(2)
    async with bus_on(made) as (bus, (x, y)):
        x.enable()
        move = x.move_to(100.0)
        await asyncio.sleep(1.0)
        report = await bus.emergency_stop()
        assert report.all_standing
        assert str(report) == "MKS 1 standing, MKS 2 standing"
        assert move.state.value == "cancelled"
        with pytest.raises(EmergencyStopped, match="clear_emergency_stop"):
            x.move_to(1.0)
        with pytest.raises(EmergencyStopped):
            await bus.unit(2).write_register(0x84, 16)
        assert await y.position() == 0.0
        bus.clear_emergency_stop()
        with pytest.raises(RearmRequired, match="an emergency stop was made"):
            await x.move_to(1.0)
        await usable(x)


@virtual
async def test_the_emergency_stop_cannot_be_cleared_before_its_report() -> None:
    async with bus_on(plant()) as (bus, _):
        handle = bus.emergency_stop()
        with pytest.raises(Exception, match="await its handle"):
            bus.clear_emergency_stop()
        await handle
        bus.clear_emergency_stop()


@virtual
async def test_raw_writes_are_not_repeated_unless_told_so() -> None:
    class Forgetful(SimUnit):
        """Does what it is told and loses every second reply."""

        lost = 0

        def receive(self, frame: bytes, now: float) -> bytes | None:
            reply = super().receive(frame, now)
            self.lost += frame[1] == 6
            return None if frame[1] == 6 and self.lost % 2 else reply

    unit = Forgetful(7, {0: 0, 1: 0})
    async with open_bus(VirtualLine(unit)) as bus:
        with pytest.raises(OutcomeUnknown) as unknown:
            await bus.unit(7).write_register(0, 5)
        assert (unknown.value.attempts, len(unit.writes)) == (1, 1)
        assert unknown.value.records[-1].outcome == "no reply"
        await asyncio.sleep(1.0)
        unit.lost = 0
        await bus.unit(7).write_register(1, 6, repeat=Repeat.SAFE)
        await asyncio.sleep(1.0)
        unit.lost = 0
        await bus.unit(7).write_register(0, 7, repeat=Repeat.VERIFY)
        assert [values for _, _, values in unit.writes] == [(5,), (6,), (6,), (7,)]


@virtual
async def test_after_closing_everything_says_so() -> None:
    async with bus_on(plant()) as (_, (x,)):
        await x.position()
    with pytest.raises(BusClosed, match="the bus is closed"):
        await x.position()


@virtual
async def test_a_broadcast_that_another_family_would_act_on() -> None:
    async with bus_on(plant(2)) as (bus, (x, y)):
        await bus.broadcast.write_register(0xF3, 1)
        y.attached.family = "OTHER"
        with pytest.raises(BroadcastConflict, match="0x0091 means something to MKS and OTHER devices"):
            await bus.broadcast.write_register(0x91, 1)
        with pytest.raises(BroadcastConflict, match="not only to MKS"):
            await bus.broadcast.write_register(0x91, 1, family="MKS")
        await bus.broadcast.write_register(0x4000, 1)  # nobody listens
        await usable(x)


@virtual
async def test_while_the_port_is_lost_nothing_that_moves_is_taken() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        await x.enable()
        made.line.unplug()
        await asyncio.sleep(0.5)
        for verb in (lambda: x.move_to(3.0), lambda: x.move_by(1.0), lambda: x.run(60), x.home, x.enable, x.set_zero):
            with pytest.raises(NotSent, match="the port is lost"):
                verb()
        stop = x.stop()
        made.line.plug()
        await stop
        await asyncio.sleep(2.0)
        assert made.stands()
        await usable(x)


@virtual
async def test_a_closed_bus_says_so_to_who_stops_by_it() -> None:
    made = plant()
    async with bus_on(made) as (bus, (x,)):
        await x.enable()
    for verb in (x.stop, x.emergency_stop, bus.emergency_stop, x.enable):
        with pytest.raises(BusClosed):
            verb()
    await bus.drain()


@virtual
async def test_a_drive_that_another_program_left_turning_is_stopped_first() -> None:
    made = plant()
    async with bus_on(made, BusConfig(leave_running=True)) as (_, (x,)):
        await x.enable()
        await x.run(300)
    assert not made.stands()
    async with bus_on(made) as (_, (x,)):
        await x.enable()
        assert made.stands()
        assert await x.move_by(1.0)


@virtual
async def test_a_drive_that_turns_is_stopped_before_it_is_set_to_zero() -> None:
    made = plant()
    async with bus_on(made, BusConfig(leave_running=True)) as (_, (x,)):
        await x.enable()
        await x.run(300)
    async with bus_on(made) as (_, (x,)):
        await x.set_zero()
        assert made.stands()
        assert await x.position() == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("timeout", [None, "5", float("nan"), float("inf"), 0, -1])
@virtual
async def test_a_time_that_is_none_is_refused_before_anything_is_sent(timeout: Any) -> None:
    made = plant()
    async with bus_on(made) as (bus, (x,)):
        await x.enable()
        before = bus.stats.transactions
        for verb in (lambda: x.home(timeout=timeout), lambda: x.watchdog(timeout)):
            with pytest.raises(TypeError if timeout in (None, "5") else LimitExceeded):
                verb()
        assert bus.stats.transactions == before


@virtual
async def test_what_cannot_be_called_is_not_called_back() -> None:
    async with bus_on(plant()) as (bus, (x,)):
        with pytest.raises(TypeError, match="callback must be a function, not None"):
            bus.on_lost(None)  # type: ignore[arg-type]  # what is tried
        await usable(x)


@virtual
async def test_an_error_that_nobody_foresaw_stops_the_axis() -> None:
    made = plant()
    with pytest.raises(ExceptionGroup):
        async with bus_on(made) as (_, (x,)):
            await x.enable()
            x._executor.short = lambda move: 1 / 0  # type: ignore[method-assign]
            run = x.run(300)
            await asyncio.sleep(5.0)
            assert isinstance(run.error, MotionError)
            assert isinstance(run.error.__cause__, ZeroDivisionError)
            assert made.stands()


@virtual
async def test_what_is_no_axis_is_not_guarded() -> None:
    async with bus_on(plant()) as (bus, (x,)):
        with pytest.raises(TypeError, match=r"guards axes, not \[<MKS 1>\]"):
            bus.watchdog([x], timeout=1.0)  # type: ignore[arg-type]


def test_a_path_is_a_port() -> None:
    async def main() -> None:
        with pytest.raises(PortNotFound, match="/dev/ttyNOPE"):
            await open_bus(Path("/dev/ttyNOPE"), baudrate=9600)

    asyncio.run(main())
