"""The same relative moves as scripts have them: pymodbus' own client with its defaults, each drive as its manual says.

A move is started, and waited for until the drive says that it stands. An answer that says "no" counts as not done.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ModbusException

from rs485bus.devices.mks import registers as mks
from rs485bus.devices.mks.values import Status
from rs485bus.devices.tlr import registers as tlr
from rs485bus.devices.tlr.values import ControlWord as TlrControl
from rs485bus.devices.tlr.values import StatusWord
from rs485bus.devices.zlac import registers as zlac
from rs485bus.devices.zlac.values import ControlMode, ControlWord
from rs485bus.sim.campaigns.moves.plant import SHAFTS, Ledger, Plant, Tally, ways
from rs485bus.sim.virtual_line import VirtualLine

_LOOKS = 0.03
"""Seconds before each look at a drive: it takes some milliseconds to begin to move."""
_MOST_LOOKS = 500
_TRIES = 20


class _Port(asyncio.Transport):
    """The virtual line, as pymodbus' client writes to it."""

    def __init__(self, line: VirtualLine, client: Any) -> None:
        super().__init__()
        self._line = line
        self._client = client

    def received(self, data: bytes) -> None:
        self._client.data_received(data)

    def lost(self, error: Exception | None) -> None:
        self._client.connection_lost(error)

    def write(self, data: Any) -> None:
        self._line.write(bytes(data))

    def close(self) -> None:
        self._line.hear(None)


def _connected(line: VirtualLine) -> AsyncModbusSerialClient:
    """pymodbus' client on the virtual line. Frames that it begins before t3.5 are understood all the same."""
    client = AsyncModbusSerialClient("virtual", baudrate=line.line.baudrate)
    line.pair.lenient = True

    async def create() -> tuple[asyncio.Transport, Any]:
        port = _Port(line, client.ctx)
        await line.open(port)
        client.ctx.connection_made(port)
        return port, client.ctx

    client.ctx.call_create = create
    return client


class _Script(ABC):
    """What a script does with one motor."""

    def __init__(self, client: AsyncModbusSerialClient, unit: int) -> None:
        self._client = client
        self._unit = unit

    @abstractmethod
    async def set_up(self) -> None:
        """Enable it."""

    @abstractmethod
    async def start(self, way: float) -> None:
        """Begin to go a way, in turns."""

    @abstractmethod
    async def stands(self) -> bool:
        """Whether the drive says that it stands."""

    async def move(self, way: float) -> None:
        """Go a way, and wait until it stands. Raises `ModbusException` or `TimeoutError`."""
        await self.start(way)
        for _ in range(_MOST_LOOKS):
            await asyncio.sleep(_LOOKS)
            if await self.stands():
                return
        raise TimeoutError("it does not come to a stand")

    async def _write(self, register: int, *values: int) -> None:
        answer = await self._client.write_register(register, values[0], device_id=self._unit)
        self._check(answer)

    async def _write_block(self, register: int, data: bytes) -> None:
        words = [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]
        answer = await self._client.write_registers(register, words, device_id=self._unit)
        self._check(answer)
        if answer.count != len(words):
            raise ModbusException("refused")

    async def _read(self, register: int, count: int) -> Sequence[int]:
        answer = await self._client.read_holding_registers(register, count=count, device_id=self._unit)
        self._check(answer)
        return answer.registers

    def _check(self, answer: Any) -> None:
        if answer.isError():
            raise ModbusException(str(answer))


class _Mks(_Script):
    async def set_up(self) -> None:
        await self._write(mks.ENABLE.address, 1)

    async def start(self, way: float) -> None:
        await self._write_block(mks.MOVE_COUNTS.address, mks.MOVE_COUNTS.encode(255, 600, round(16384 * way)))

    async def stands(self) -> bool:
        answer = await self._client.read_input_registers(mks.STATUS.address, count=1, device_id=self._unit)
        self._check(answer)
        return bool(answer.registers[0] == Status.STOPPED)


class _Tlr(_Script):
    async def set_up(self) -> None:
        """It is enabled when it is switched on."""

    async def start(self, way: float) -> None:
        await self._write_block(tlr.POSITIONING.address, tlr.POSITIONING.encode(5, 30, 30, 600, round(4000 * way)))
        await self._write(tlr.CONTROL.address, 0)
        await self._write(tlr.CONTROL.address, int(TlrControl.POSITION))

    async def stands(self) -> bool:
        return not StatusWord((await self._read(tlr.STATUS.address, 1))[0]) & StatusWord.RUNNING


class _Wheel(_Script):
    """One wheel of a ZLAC, asynchronous control."""

    def __init__(self, client: AsyncModbusSerialClient, unit: int, right: bool) -> None:
        super().__init__(client, unit)
        self._right = right
        self._counts = 0

    async def set_up(self) -> None:
        await self._write(zlac.SYNCHRONY.address, 0)
        await self._write(zlac.MODE.address, ControlMode.POSITION_RELATIVE)
        for twin, value in ((zlac.ACCELERATION_TIME, 100), (zlac.DECELERATION_TIME, 100), (zlac.POSITION_SPEED, 200)):
            await self._write((twin.right if self._right else twin.left).address, value)
        await self._write(zlac.CONTROL.address, ControlWord.ENABLE)

    async def start(self, way: float) -> None:
        target = zlac.TARGET_POSITION.right if self._right else zlac.TARGET_POSITION.left
        await self._write_block(target.address, target.encode(round(4096 * way)))
        await self._write(zlac.CONTROL.address, ControlWord.START_RIGHT if self._right else ControlWord.START_LEFT)

    async def stands(self) -> bool:
        status = (await self._read(zlac.STATUS.address, 1))[0]
        return not (status >> 8 if self._right else status) & 1


async def move(plant: Plant, moves: int, seed: int, tally: Tally) -> None:
    """Send each shaft so many times, all of them at once."""
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    client = _connected(plant.line)
    await client.connect()
    scripts = [
        *(_Mks(client, at) for at in (1, 2)),
        *(_Tlr(client, at) for at in (3, 4)),
        *(_Wheel(client, 5, right) for right in (False, True)),
    ]
    for script in scripts:
        await _ready(script)
    try:
        await asyncio.gather(*(_use(*each, plant, moves, seed, tally) for each in zip(SHAFTS, scripts, strict=True)))
    finally:
        client.close()


async def _use(name: str, script: _Script, plant: Plant, moves: int, seed: int, tally: Tally) -> None:
    now = asyncio.get_running_loop().time
    zero = plant.turns(name, now())
    ledger = Ledger(tally, lambda: plant.turns(name, now()) - zero)
    for way in ways(name, moves, seed):
        try:
            await script.move(way)
        except (ModbusException, TimeoutError) as error:
            ledger.failed(error)
        else:
            ledger.acknowledged(way)
    ledger.close()


async def _ready(script: _Script) -> None:
    for _ in range(_TRIES):
        with contextlib.suppress(ModbusException):
            await script.set_up()
            return
