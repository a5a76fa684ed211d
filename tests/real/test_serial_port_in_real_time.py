"""The serial stack on a real pseudo-terminal, in real time: nothing of it is replaced."""

import asyncio
import errno
import functools
import logging
import os
import resource
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial
from serial.rs485 import RS485Settings
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

import rs485bus
from rs485bus import BusConfig, MksServo, open_bus
from rs485bus.errors import NoReply, NotSent, PortBusy, PortError, PortPermissionDenied
from rs485bus.sim import SimMks, SimUnit, VirtualLine
from rs485bus.transport import serial as serial_transport
from rs485bus.transport import serialx_port
from rs485bus.transport.holders import holders
from rs485bus.wire.timing import LineSettings
from tests.bus.support import Deaf
from tests.real.support import in_real_time, posix, running

pytestmark = posix


@pytest.fixture(autouse=True, params=["pyserial", "serialx"])
def backend(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Every test runs on both."""
    if request.param == "serialx":
        pytest.importorskip("serialx", reason="serialx is missing: pip install serialx")
    monkeypatch.setitem(globals(), "open_bus", functools.partial(rs485bus.open_bus, backend=request.param))
    return str(request.param)


async def until(holds: Callable[[], bool]) -> None:
    """Wait for something, ten seconds at the most."""
    for _ in range(1000):
        if holds():
            return
        await asyncio.sleep(0.01)
    raise AssertionError("it did not come")


BANK = {register: 100 + register for register in range(16)}


def test_an_axis_moves_over_a_real_port() -> None:
    async def main() -> None:
        sim = SimMks(1)
        line = VirtualLine(sim, baudrate=115200)
        async with await line.serve_pty() as port, open_bus(port.path, baudrate=115200) as bus:
            x = MksServo(bus, 1)
            async with x.watchdog(0.5):
                x.enable()
                assert await x.move_to(2.0, rpm=1200, acceleration=10_000) == 2.0
                await asyncio.sleep(0.5)
            assert sim.trips == []
            assert sim.watchdog_ms == 0
        assert line.pair.early_frames == 0

    in_real_time(main)


def test_a_port_that_is_in_use_says_by_whom() -> None:
    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK))
        async with await line.serve_pty() as port, open_bus(port.path, baudrate=115200):
            with pytest.raises(PortBusy, match=rf"in use by .*\(process {os.getpid()}\)"):
                await open_bus(port.path, baudrate=115200)

    in_real_time(main)


def test_a_port_that_may_not_be_opened_says_what_to_do(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*args: object, **kwargs: object) -> None:
        raise serial.SerialException(errno.EACCES, "could not open port: Permission denied")

    monkeypatch.setattr(serial_transport, "_Port", refuse)
    if backend == "serialx":
        monkeypatch.setattr("serialx.create_serial_connection", refuse)
    with pytest.raises(PortPermissionDenied, match=r"usermod -aG dialout"):
        asyncio.run(_open("/dev/ttyS0"))


async def _open(path: str) -> None:
    await open_bus(path, baudrate=9600)


def test_something_that_is_no_serial_port_says_so(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(PortError, match="could not be opened as a serial port"):
        asyncio.run(_open(str(file)))


def test_the_wrong_baud_rate_is_no_reply_and_the_message_names_it() -> None:
    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK), baudrate=9600)
        async with await line.serve_pty() as port, open_bus(port.path, baudrate=115200) as bus:
            with pytest.raises(NoReply, match="baud rate"):
                await bus.unit(1).read_holding_registers(0)

    in_real_time(main)


def test_a_port_that_vanishes_is_opened_again(tmp_path: Path) -> None:
    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK))
        link = tmp_path / "port"
        config = BusConfig(reopen_min=0.05, reopen_max=0.1)
        port = await line.serve_pty(link)
        async with open_bus(str(link), baudrate=115200, config=config) as bus:
            assert await bus.unit(1).read_holding_registers(3) == [103]
            await port.aclose()
            await asyncio.sleep(0.1)
            assert not bus.connected
            reading = asyncio.create_task(bus.unit(1).read_holding_registers(4))
            await asyncio.sleep(0.2)
            port = await line.serve_pty(link)
            assert await asyncio.wait_for(reading, 5) == [104]
        await port.aclose()

    in_real_time(main)


def test_a_port_is_opened_again_on_the_same_adapter_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    plugged: list[ListPortInfo] = []
    monkeypatch.setattr(list_ports, "comports", lambda: plugged)

    def plug(path: str, serial_number: str) -> None:
        info = ListPortInfo(path)
        info.serial_number = serial_number
        plugged[:] = [info]

    async def main() -> None:
        ours, foreign = VirtualLine(SimUnit(1, BANK)), VirtualLine(SimUnit(1, {3: 666}))
        link = tmp_path / "port"
        config = BusConfig(reopen_min=0.05, reopen_max=0.1)
        port = await ours.serve_pty(link)
        plug(port.path, "A1")
        async with open_bus(str(link), baudrate=115200, config=config) as bus:
            assert await bus.unit(1).read_holding_registers(3) == [103]
            await port.aclose()
            await until(lambda: not bus.connected)
            reading = asyncio.create_task(bus.unit(1).read_holding_registers(3, timeout=10))
            async with await foreign.serve_pty(link) as other:
                plug(other.path, "B2")
                await asyncio.sleep(0.5)
                assert not bus.connected
                with pytest.raises(NotSent, match=r"another adapter now .*serial number B2"):
                    await bus.unit(1).read_holding_registers(3, timeout=0.1)
            port = await ours.serve_pty(link)
            plug(port.path, "A1")
            assert await asyncio.wait_for(reading, 5) == [103]
        await port.aclose()

    in_real_time(main)


def test_a_program_that_reads_along_is_named_where_replies_go_missing(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        line = VirtualLine(Deaf(1))
        async with await line.serve_pty() as port:
            async with open_bus(port.path, baudrate=115200) as bus:
                await asyncio.sleep(0.2)
                assert "open, too" not in caplog.text
            bus = await open_bus(port.path, baudrate=115200, config=BusConfig(reply_timeout=0.3))
            await asyncio.sleep(0.3)  # at opening it was looked already
            async with running("sh", "-c", f"exec sleep 30 < {port.path}") as other:
                await until(lambda: other.pid in holders(port.path))
                named = f"sleep (process {other.pid}) has {port.path} open, too"
                for _ in range(5):
                    was_said = named in caplog.text  # on a busy machine to look for it may take longer than a read
                    with pytest.raises(NoReply) as missing:
                        await bus.unit(1).read_holding_registers(0)
                    if named in str(missing.value):
                        break
                    assert not was_said
                assert named in str(missing.value)
                assert "takes bytes away: close it." in caplog.text
            await bus.aclose()

    in_real_time(main)


def test_a_program_that_has_the_port_open_already_is_named_at_opening(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK))
        async with await line.serve_pty() as port, running("cat", port.path) as cat:
            await until(lambda: str(cat.pid) in str(holders(port.path)))
            async with open_bus(port.path, baudrate=115200):
                await until(lambda: "open, too" in caplog.text)
            assert f"cat (process {cat.pid}) has {port.path} open, too" in caplog.text

    in_real_time(main)


def test_the_other_end_of_a_pseudo_terminal_reads_nothing_along(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        command = (sys.executable, "-m", "rs485bus", "sim", "--mks", "1")
        process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
        assert process.stdout is not None
        path = (await process.stdout.readline()).decode().strip()
        async with open_bus(path, baudrate=38400):
            await asyncio.sleep(0.5)
        process.terminate()
        await process.communicate()
        assert "open, too" not in caplog.text

    in_real_time(main)


@pytest.fixture
def high_descriptors() -> Iterator[None]:
    """All descriptors up to 1100 are taken."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 1300:
        pytest.skip(f"this user may open {hard} files only")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 1300), hard))
    taken = [os.open(os.devnull, os.O_RDONLY) for _ in range(1100)]
    yield
    for descriptor in taken:
        os.close(descriptor)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.usefixtures("high_descriptors")
def test_a_file_descriptor_above_1023_works_and_does_not_spin() -> None:
    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK))
        async with await line.serve_pty() as port, open_bus(port.path, baudrate=115200) as bus:
            assert await bus.unit(1).read_holding_registers(3) == [103]
            used = time.process_time()
            await asyncio.sleep(0.3)
            assert time.process_time() - used < 0.15

    in_real_time(main)


def test_closing_does_not_block_although_nobody_reads_the_other_end() -> None:
    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK))
        async with await line.serve_pty() as port:
            bus = await open_bus(port.path, baudrate=115200)
            asyncio.get_running_loop().remove_reader(port._master)
            asking = asyncio.create_task(bus.unit(1).read_holding_registers(3))
            await asyncio.sleep(0.01)
            begun = time.monotonic()
            await bus.aclose()
            assert time.monotonic() - begun < 1.0
            with pytest.raises(NoReply):
                await asking

    in_real_time(main)


def test_an_opening_that_is_cancelled_leaves_the_port_free() -> None:
    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK))
        async with await line.serve_pty() as port:
            for turns in range(4):
                opening = asyncio.create_task(_open(port.path))
                for _ in range(turns):
                    await asyncio.sleep(0)
                opening.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await opening
            await asyncio.sleep(0.1)
            async with open_bus(port.path, baudrate=115200) as bus:
                assert await bus.unit(1).read_holding_registers(3) == [103]

    in_real_time(main)


def test_a_driver_that_cannot_switch_the_direction_says_so() -> None:
    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK))
        async with await line.serve_pty() as port:
            with pytest.raises(PortError, match="Leave rs485_direction off"):
                await open_bus(port.path, baudrate=115200, config=BusConfig(rs485_direction=True))

    in_real_time(main)


def test_the_direction_is_switched_with_the_polarity_and_the_delays_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serialx_port, "switch_direction", lambda fd, settings: asked.append(settings))
    asked: list[RS485Settings] = []
    monkeypatch.setattr(
        serial_transport._Port, "rs485_mode", property(None, lambda port, settings: asked.append(settings))
    )
    inverted = RS485Settings(rts_level_for_tx=False, rts_level_for_rx=True, delay_before_tx=0.004)

    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK))
        async with await line.serve_pty() as port:
            for direction in (True, inverted):
                async with open_bus(port.path, baudrate=115200, config=BusConfig(rs485_direction=direction)) as bus:
                    assert await bus.unit(1).read_holding_registers(3) == [103]
                    latency = bus._transport.receive_latency  # type: ignore[attr-defined]
                    assert latency == (0.0 if direction is True else 0.004)

    in_real_time(main)
    assert asked[0].rts_level_for_tx is True
    assert asked[1] is inverted


def test_delays_that_the_kernel_does_not_have_are_refused() -> None:
    with pytest.raises(ValueError, match=r"delay_before_tx 0.2 is outside 0..0.1"):
        BusConfig(rs485_direction=RS485Settings(delay_before_tx=0.2))
    with pytest.raises(TypeError, match="rs485_direction"):
        BusConfig(rs485_direction="yes")  # type: ignore[arg-type]


def test_a_slow_latency_timer_is_warned_of_with_the_command_that_mends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    timer = tmp_path / "latency_timer"
    timer.write_text("16\n")
    monkeypatch.setattr(serial_transport, "_latency_timer", lambda port: timer)

    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK))
        async with await line.serve_pty() as port, open_bus(port.path, baudrate=115200) as bus:
            assert bus._transport.receive_latency == 0.016  # type: ignore[attr-defined]

    with caplog.at_level(logging.WARNING):
        in_real_time(main)
    assert "only every 16 ms" in caplog.text
    assert f"echo 1 | sudo tee {timer}" in caplog.text


def test_settings_that_a_port_does_not_have_are_told() -> None:
    async def main() -> None:
        line = VirtualLine(SimUnit(1, BANK), baudrate=9600, parity="E")
        async with await line.serve_pty() as port:
            # Linux' pseudo-terminals know no parity.
            with pytest.raises(PortError, match="9600 bit/s, 8E1"):
                await open_bus(port.path, baudrate=9600, parity="E")

    in_real_time(main)
    assert LineSettings(baudrate=9600, parity="E").character == 11 / 9600
