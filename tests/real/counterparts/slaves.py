"""The slaves, and the ways to them."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.real.support import free_port, null_modem, run, running

HERE = Path(__file__).parent
FROM_NPM = "NODE_PATH"
"""Where `npm install modbus-serial` has put it: its node_modules."""

OF_LIBMODBUS = (1, 2, 3, 4, 5, 6, 15, 16, 17, 22, 23)
OF_PYMODBUS = (1, 2, 3, 4, 5, 6, 7, 8, 11, 12, 15, 16, 17, 20, 21, 22, 23, 24, 43)
OF_MODBUS_SERIAL = (1, 2, 3, 4, 5, 6, 15, 16, 43)
"""It has 17, too, but its serial server drops requests of less than six bytes (8.0.25)."""


class Missing(Exception):
    """Something is not installed; the message says what."""


@dataclass(frozen=True)
class Slave:
    """One program as a slave."""

    functions: tuple[int, ...]
    command: Callable[[Path, str], list[str]]
    """How to start it, from a folder for what is built, and where it is to be reached."""
    way: str
    """"serial", "rtu over tcp", "tcp", "socat", "ser2net", "rfc2217" (by ser2net)."""


def _pymodbus(kind: str) -> Callable[[Path, str], list[str]]:
    return lambda folder, where: [sys.executable, str(HERE / "pymodbus_slave.py"), kind, where]


def _libmodbus(*kind: str) -> Callable[[Path, str], list[str]]:
    return lambda folder, where: [str(folder / "slave"), *(kind or ()), where, *(() if kind else ("115200",))]


def _modbus_serial(kind: str) -> Callable[[Path, str], list[str]]:
    return lambda folder, where: ["node", str(HERE / "modbus_serial_slave.js"), kind, where]


SLAVES = {
    "pymodbus-serial": Slave(OF_PYMODBUS, _pymodbus("serial"), "serial"),
    "pymodbus-rtu-over-tcp": Slave(OF_PYMODBUS, _pymodbus("rtu-over-tcp"), "rtu over tcp"),
    "pymodbus-tcp": Slave(OF_PYMODBUS, _pymodbus("tcp"), "tcp"),
    "libmodbus": Slave(OF_LIBMODBUS, _libmodbus(), "serial"),
    "libmodbus-tcp": Slave(OF_LIBMODBUS, _libmodbus("tcp"), "tcp"),
    "socat-libmodbus": Slave(OF_LIBMODBUS, _libmodbus(), "socat"),
    "ser2net-libmodbus": Slave(OF_LIBMODBUS, _libmodbus(), "ser2net"),
    "ser2net-rfc2217-libmodbus": Slave(OF_LIBMODBUS, _libmodbus(), "rfc2217"),
    "modbus-serial": Slave(OF_MODBUS_SERIAL, _modbus_serial("serial"), "serial"),
    "modbus-serial-tcp": Slave(OF_MODBUS_SERIAL, _modbus_serial("tcp"), "tcp"),
}


class Running:
    """A slave that can be restarted."""

    def __init__(self, command: list[str]) -> None:
        self._command = command
        self._stack = AsyncExitStack()

    async def start(self) -> None:
        await self._stack.enter_async_context(running(*self._command, ready="ready"))

    async def stop(self) -> None:
        await self._stack.aclose()

    async def restart(self) -> None:
        """Kill it, leave it dead for a moment, start it anew."""
        await self.stop()
        await asyncio.sleep(0.2)
        await self.start()


@asynccontextmanager
async def reached(slave: Slave, folder: Path) -> AsyncIterator[tuple[str, Running]]:
    """Start a slave, and whatever leads to it. Yields what to open, and the slave."""
    await _need(slave, folder)
    async with AsyncExitStack() as stack:
        if slave.way in ("tcp", "rtu over tcp"):
            where = str(free_port())
            url = f"{'tcp' if slave.way == 'tcp' else 'socket'}://127.0.0.1:{where}"
        else:
            ours, where = await stack.enter_async_context(null_modem(folder))
            url = ours
        program = Running(slave.command(folder, where))
        await program.start()
        stack.push_async_callback(program.stop)
        if slave.way in ("socat", "ser2net", "rfc2217"):
            number = free_port()
            url = f"{'rfc2217' if slave.way == 'rfc2217' else 'socket'}://127.0.0.1:{number}"
            await stack.enter_async_context(running(*_gateway(slave.way, number, ours, folder)))
            await asyncio.sleep(0.5)
        yield url, program


def _gateway(way: str, number: int, port: str, folder: Path) -> list[str]:
    if way == "socat":
        return ["socat", f"tcp-listen:{number},bind=127.0.0.1,reuseaddr,fork", f"{port},rawer,b115200"]
    config = folder / "ser2net.yaml"
    accepter = "telnet(rfc2217),tcp" if way == "rfc2217" else "tcp"
    config.write_text(
        f"connection: &c\n  accepter: {accepter},127.0.0.1,{number}\n"
        f"  connector: serialdev,{port},115200n81,local\n  options:\n    kickolduser: true\n"
    )
    return ["ser2net", "-n", "-c", str(config)]


async def _need(slave: Slave, folder: Path) -> None:
    """Build what must be built. Raises `Missing`."""
    program = slave.command(folder, "")[0]
    if slave.way not in ("tcp", "rtu over tcp") and shutil.which("socat") is None:
        raise Missing("socat is missing: sudo apt-get install socat")
    if slave.way in ("ser2net", "rfc2217") and shutil.which("ser2net") is None:
        raise Missing("ser2net is missing: sudo apt-get install ser2net")
    if program == "node":
        modules = os.environ.get(FROM_NPM, "")
        if shutil.which("node") is None or not (Path(modules) / "modbus-serial").is_dir():
            raise Missing(
                "modbus-serial is missing: npm install modbus-serial serialport, and say where: "
                f"{FROM_NPM}=$PWD/node_modules"
            )
    if program == str(folder / "slave"):
        source = HERE / "libmodbus_slave.c"
        with contextlib.suppress(AssertionError, FileNotFoundError):
            await run("gcc", "-o", program, str(source), "-I/usr/include/modbus", "-lmodbus")
        if shutil.which(program) is None:
            raise Missing("libmodbus is missing: sudo apt-get install gcc libmodbus-dev")
