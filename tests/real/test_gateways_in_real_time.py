"""Gateways that do as they like, on real sockets, in real time."""

import asyncio
import contextlib
import logging
import signal
import socket
import struct
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from rs485bus import Bus, BusConfig, open_bus
from rs485bus.errors import NoReply, NotSent, OutcomeUnknown, PortNotFound
from rs485bus.sim import SimUnit, VirtualLine
from tests.real.support import free_port, in_real_time, needs, posix, running


class Gateway:
    """Accepts connections and does nothing with them by itself. Its receive buffer is as small as can be."""

    def __init__(self) -> None:
        self._connections: list[socket.socket] = []
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2304)
        self._listener.bind(("127.0.0.1", 0))
        self._listener.listen()
        self._listener.setblocking(False)
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"

    async def accept(self) -> socket.socket:
        connection, _ = await asyncio.wait_for(asyncio.get_running_loop().sock_accept(self._listener), 5)
        connection.setblocking(False)
        self._connections.append(connection)
        return connection

    def close(self) -> None:
        for open_socket in (self._listener, *self._connections):
            open_socket.close()


@pytest.fixture
def gateway() -> Iterator[Gateway]:
    made = Gateway()
    yield made
    made.close()


async def everything(connection: socket.socket, within: float) -> bytes:
    """All that arrives within a time."""
    loop = asyncio.get_running_loop()
    got = b""
    try:
        async with asyncio.timeout(within):
            while piece := await loop.sock_recv(connection, 65536):
                got += piece
    except (TimeoutError, ConnectionError):
        pass
    return got


async def write(bus: Bus, mark: int) -> None:
    await bus.unit(1).write_registers(0, [mark] * 120)


async def broadcast(bus: Bus, mark: int) -> None:
    await bus.broadcast.write_registers(0, [mark] * 120)


@pytest.mark.parametrize("send", [write, broadcast])
def test_nothing_old_arrives_after_the_reconnection_to_a_gateway_that_stopped_reading(
    gateway: Gateway, send: Callable[[Bus, int], Awaitable[None]]
) -> None:
    async def main() -> None:
        config = BusConfig(
            retries=0, reply_timeout=0.02, turnaround=0.02, late_reply_window=0.05, echo=False, offline_after=100
        )
        async with open_bus(gateway.url, baudrate=1_000_000, config=config) as bus:
            old = await gateway.accept()
            mark = 0x4100
            while bus.connected:
                mark += 1
                with contextlib.suppress(OutcomeUnknown):
                    await send(bus, mark)
            new = await gateway.accept()
            arrived, fresh = await asyncio.gather(everything(old, 0.5), everything(new, 0.5))
            assert struct.pack(">H", mark - 1) * 120 in arrived
            assert struct.pack(">H", mark) * 120 not in arrived
            assert fresh == b""

    in_real_time(main)


def test_a_gateway_that_hangs_up_at_once_leaves_reads_with_an_error_that_says_what_to_do(
    gateway: Gateway, caplog: pytest.LogCaptureFixture
) -> None:
    connects = 0

    async def hang_up() -> None:
        nonlocal connects
        while True:
            (await gateway.accept()).close()
            connects += 1

    async def main() -> None:
        hanging_up = asyncio.create_task(hang_up())
        async with open_bus(gateway.url) as bus:
            # It is not sent, or just so before the gateway hangs up.
            said = r"one client at a time.*If the gateway is set to Modbus TCP, open tcp://"
            with pytest.raises((NotSent, NoReply), match=said):
                await bus.unit(1).read_holding_registers(0, timeout=2.0)
            hanging_up.cancel()
        assert 1 <= connects <= 6
        told = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
        assert sum("socket://" in text for text in told) == 1

    in_real_time(main)


def test_a_gateway_that_has_closed_its_end_is_lost_although_it_does_not_take_what_is_unsent(gateway: Gateway) -> None:
    async def main() -> None:
        async with open_bus(gateway.url, config=BusConfig(reopen_min=0.1)) as bus:
            old = await gateway.accept()
            bus._transport.write(bytes(5_000_000))
            old.shutdown(socket.SHUT_WR)
            await asyncio.wait_for(gateway.accept(), 0.7)
            await asyncio.sleep(0.05)
            assert bus.connected

    in_real_time(main)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what is unacknowledged")
def test_what_is_under_way_and_not_acknowledged_yet_is_not_unsent(gateway: Gateway) -> None:
    from rs485bus.transport.connection import _SIOCOUTQ, _queued

    async def main() -> None:
        async with open_bus(gateway.url, baudrate=4_000_000, config=BusConfig(reply_timeout=1.0)) as bus:
            connection, wire = await gateway.accept(), bus._transport
            for _ in range(20):  # whoever answers acknowledges by its answers; if there is none, after 40 ms
                connection.send(b"noise")
                wire.write(b"request")
                await asyncio.sleep(0.001)
            assert _queued(wire._connection.transport.get_extra_info("socket"), _SIOCOUTQ)  # type: ignore[attr-defined]
            assert wire.unsent == 0

    in_real_time(main)


RTU_ANSWER = bytes.fromhex("01 03 02 12 34 B5 33")


@pytest.mark.parametrize(
    ("ours", "other", "answer", "said"),
    [
        ("tcp", "socket", RTU_ANSWER, "answers in RTU frames, not in Modbus TCP: open socket://127.0.0.1:"),
        (
            "socket",
            "tcp",
            bytes.fromhex("0103 0000 0003 840A 01"),
            "answers in Modbus TCP frames, not in RTU: open tcp://",
        ),
        ("tcp", "socket", b"", r"set to raw TCP \(RTU over TCP, transparent\), open socket://127.0.0.1:"),
        ("socket", "tcp", b"", "set to Modbus TCP, open tcp://127.0.0.1:"),
    ],
)
def test_a_gateway_that_is_set_to_another_mode_is_told_with_what_to_open_instead(
    gateway: Gateway, ours: str, other: str, answer: bytes, said: str
) -> None:
    async def main() -> None:
        port = gateway.url.rpartition(":")[2]
        async with open_bus(f"{ours}://127.0.0.1:{port}", config=BusConfig(retries=0)) as bus:
            connection = await gateway.accept()
            reading = asyncio.create_task(bus.unit(1).read_holding_registers(0))
            await asyncio.get_running_loop().sock_recv(connection, 256)
            connection.send(answer)
            with pytest.raises(NoReply, match=said):
                await reading

    in_real_time(main)


SER2NET = """connection: &c
  accepter: telnet(rfc2217),tcp,127.0.0.1,{number}
  connector: serialdev,{path},9600n81,local
"""


@pytest.mark.parametrize("server", ["pyserial", pytest.param("ser2net", marks=needs("ser2net"))])
@posix
def test_a_port_of_another_machine_by_rfc_2217(server: str, tmp_path: Path) -> None:
    pytest.importorskip("serialx", reason="serialx is missing: pip install serialx")

    def command(path: str, number: int) -> tuple[str, ...]:
        if server == "pyserial":
            return sys.executable, str(Path(__file__).with_name("rfc2217_server.py")), path, str(number)
        (tmp_path / "ser2net.yaml").write_text(SER2NET.format(path=path, number=number))
        return "ser2net", "-n", "-d", "-c", str(tmp_path / "ser2net.yaml")

    async def main() -> None:
        unit = SimUnit(3, {register: 100 + register for register in range(8)})
        line = VirtualLine(unit, baudrate=38400)
        number = free_port()
        async with await line.serve_pty() as pty, running(*command(pty.path, number)), AsyncExitStack() as stack:
            for _ in range(200):
                # The pseudo-terminal understands its own baud rate only: that it answers tells that it was set.
                with contextlib.suppress(PortNotFound):
                    bus = await stack.enter_async_context(open_bus(f"rfc2217://127.0.0.1:{number}", baudrate=38400))
                    break
                await asyncio.sleep(0.05)
            assert await bus.unit(3).read_holding_registers(2, 2) == [102, 103]
            await bus.unit(3).write_register(5, 0xFF)
            values = [await bus.unit(3).read_holding_registers(at) for at in range(6)]
            assert values == [[100], [101], [102], [103], [104], [0xFF]]

    in_real_time(main)


class Recorder(VirtualLine):
    """Keeps what is sent."""

    seen = b""

    def transmit(self, data: bytes, now: float) -> None:
        self.seen += data


@posix
def test_nothing_old_arrives_at_a_port_of_another_machine_that_stopped_reading() -> None:
    pytest.importorskip("serialx", reason="serialx is missing: pip install serialx")
    server = str(Path(__file__).with_name("rfc2217_server.py"))

    async def main() -> None:
        line = Recorder(baudrate=1_000_000)
        number = free_port()
        quick = {"retries": 0, "reply_timeout": 0.02, "late_reply_window": 0.05}
        config = BusConfig(**quick, echo=False, offline_after=100)  # type: ignore[arg-type]
        async with (
            await line.serve_pty() as pty,
            running(sys.executable, server, pty.path, str(number), ready="ready") as process,
            open_bus(f"rfc2217://127.0.0.1:{number}", baudrate=1_000_000, config=config) as bus,
        ):
            process.send_signal(signal.SIGSTOP)
            mark = 0x4100
            while bus.connected:
                mark += 1
                with contextlib.suppress(OutcomeUnknown):
                    await bus.unit(3).write_registers(0, [mark] * 120)
            process.send_signal(signal.SIGCONT)
            await asyncio.sleep(1.0)
            assert struct.pack(">H", mark - 1) * 120 in line.seen
            assert struct.pack(">H", mark) * 120 not in line.seen

    in_real_time(main)


def test_a_port_of_another_machine_that_is_not_there_says_what_to_check() -> None:
    pytest.importorskip("serialx", reason="serialx is missing: pip install serialx")

    async def main() -> None:
        with pytest.raises(PortNotFound, match="refused the connection"):
            await open_bus(f"rfc2217://127.0.0.1:{free_port()}", baudrate=9600)

    in_real_time(main)
