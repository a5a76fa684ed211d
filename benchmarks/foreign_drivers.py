"""Drivers that others wrote, unmodified, over a bus on which two axes move: for pymodbus and for modbus-connection.

    pip install --no-deps python-dcm230 bgetech-modbus solaxx3 hm310t step-driver-g071-api pysaunum
    pip install modbus-connection carlo-gavazzi-energy-meter-modbus ecowitt-ws90-modbus brink-flair-modbus
    python -m benchmarks.foreign_drivers

(`--no-deps`: some ask for an older pymodbus than this package does. pysaunum and the second line need Python 3.12.)
Each driver's device is simulated. What is not installed is not tried. It ends with 1 where a driver read something
wrong, or an axis was not fed in time.
"""

from __future__ import annotations

import asyncio
import importlib
import struct
import sys
import warnings
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import anyio.to_thread

from rs485bus import Bus, MksServo, open_bus
from rs485bus.compat import BusClient, SyncBusClient
from rs485bus.sim import ModbusData, SimMks, SimModbus, VirtualLine

AXES = (21, 22)
ROUNDS = 20
"""How often each driver asks for everything."""


@dataclass(frozen=True)
class Driver:
    """A driver of somebody else's, and the device it is for."""

    package: str
    module: str
    device: str
    address: int
    registers: dict[int, int]
    """What the device holds, other than zeros."""
    run: Callable[[Bus], Awaitable[str]]
    """Has the driver work; returns what it did, and raises where something was wrong."""


def main() -> int:
    warnings.simplefilter("ignore", DeprecationWarning)  # older drivers say slave=
    return asyncio.run(trial())


async def trial() -> int:
    """Every driver that is installed, one after the other."""
    with suppress(ImportError):
        importlib.import_module("rs485bus.compat.modbus_connection")
    here = [driver for driver in DRIVERS if _is_here(driver)]  # imports take long, and must not while motors turn
    sims = [SimModbus(driver.address, _holding(driver.registers)) for driver in DRIVERS]
    drives = [SimMks(address) for address in AXES]
    async with open_bus(VirtualLine(*drives, *sims, baudrate=115200)) as bus:
        axes = [MksServo(bus, address) for address in AXES]
        for axis in axes:
            await axis.enable()
        moving = [asyncio.ensure_future(_to_and_fro(axis)) for axis in axes]
        async with bus.watchdog(*axes, timeout=1.0):
            for driver in here:
                before = bus.stats.units[driver.address].requests if driver.address in bus.stats.units else 0
                done = await driver.run(bus)
                requests = bus.stats.units[driver.address].requests - before
                print(f"{driver.package} ({driver.device}): {done}; {requests} requests")
            for task in moving:
                task.cancel()
            await asyncio.gather(*moving, return_exceptions=True)
    trips = sum(len(drive.trips) for drive in drives)
    print(f"{len(here)} drivers; meanwhile the axes made {sum(_LEGS.values())} moves, {trips} watchdogs tripped")
    return 0 if here and not trips else 1


def _is_here(driver: Driver) -> bool:
    try:
        importlib.import_module(driver.module)
    except ImportError as error:
        print(f"{driver.package}: not tried ({error})")
        return False
    return True


_LEGS: dict[int, int] = {}


async def _to_and_fro(axis: MksServo) -> None:
    """Move until it is cancelled."""
    while True:
        for target in (3.0, 0.0):
            move = axis.move_to(target, rpm=300)
            with suppress(asyncio.CancelledError):
                await move
            if not move.done():
                move.cancel()
                return
            _LEGS[axis.address] = _LEGS.get(axis.address, 0) + 1


def _holding(registers: dict[int, int]) -> ModbusData:
    held = dict.fromkeys(range(0x10000), 0) | registers
    return ModbusData(registers=held, input_registers=dict(held))


def _float(value: float) -> list[int]:
    return list(struct.unpack(">HH", struct.pack(">f", value)))


def _at(first: int, *values: int) -> dict[int, int]:
    return dict(enumerate(values, first))


def check(what: str, seen: object, expected: object) -> None:
    """Raise where a driver has read something else than its device holds."""
    if seen != expected:
        raise SystemExit(f"{what}: {seen!r} was read where {expected!r} is")


# For pymodbus


async def dcm230(bus: Bus) -> str:
    """It takes a synchronous client."""
    meter = importlib.import_module("dcm230").Dcm230(11, SyncBusClient(bus))

    def work() -> None:
        for _ in range(ROUNDS):
            check("volts", float(meter.V), 48.5)
            check("amperes", float(meter.A), 2.5)
        meter.backlit_time = 20

    await anyio.to_thread.run_sync(work)
    return f"{ROUNDS} times voltage and current, one setting"


async def solaxx3(bus: Bus) -> str:
    """It makes a synchronous client by itself, and reads device 1."""
    module = importlib.import_module("solaxx3.solaxx3")
    with patch.object(module, "ModbusSerialClient", lambda **_: SyncBusClient(bus)):
        inverter = module.SolaxX3(port="/dev/ttyUSB0")

    def work() -> None:
        assert inverter.connect()
        for _ in range(3):
            inverter.read_all_registers()
            check("the first input registers", inverter._input_registers_values[:3], [2301, 2302, 2303])

    await anyio.to_thread.run_sync(work)
    return "3 times 800 registers"


async def hm310t(bus: Bus) -> str:
    """It makes a synchronous client by itself, and says `slave=` as pymodbus did before 3.10."""
    module = importlib.import_module("hm310t.transport")
    supply_of = importlib.import_module("hm310t").PowerSupply

    def work() -> None:
        with patch.object(module, "ModbusSerialClient", lambda **_: SyncBusClient(bus)):
            supply = supply_of(port="/dev/ttyUSB0", slave=13)
        with supply:
            for step in range(ROUNDS):
                supply.voltage = 5 + step / 10
                check("the voltage", round(supply.voltage, 2), round(5 + step / 10, 2))
            supply.output_enabled = True
            check("the output", supply.output_enabled, True)
            supply.output_enabled = False

    await anyio.to_thread.run_sync(work)
    return f"{ROUNDS} voltages set and read back, output on and off"


async def step_driver(bus: Bus) -> str:
    """It makes a synchronous client by itself, opens and closes it for each call, and says `slave=`."""
    module = importlib.import_module("step_driver_g071_api.step_driver")
    with patch.object(module, "ModbusSerialClient", lambda **_: SyncBusClient(bus)):
        motor = module.StepDriver(port="/dev/ttyUSB0", modbus_address=14)

    def work() -> None:
        for _ in range(ROUNDS):
            motor.go_to_pos_without_control(5000, 2000)
            motor._update_info()
        check("its status", motor.status, False)
        motor.stop()

    await anyio.to_thread.run_sync(work)
    return f"{ROUNDS} moves commanded and asked for, a stop"


async def bgetech(bus: Bus) -> str:
    """It makes an asynchronous client by itself."""
    module = importlib.import_module("bgetech_modbus.client")
    registers = importlib.import_module("bgetech_modbus.devices.ds100")
    kinds = importlib.import_module("bgetech_modbus.devices").ModbusRegister
    with patch.object(module, "AsyncModbusTcpClient", lambda **_: BusClient(bus)):
        meter = module.BGEtechClient("192.0.2.1", device_id=15)
    named = [
        value for holder in vars(registers).values() if isinstance(holder, type) for value in vars(holder).values()
    ]
    wanted = [value for value in named if isinstance(value, kinds) and 0x400 <= value.address <= 0x414]
    for _ in range(ROUNDS):
        found = {register.address: register.value for register in await meter.read_data(wanted)}
        check("volts", round(float(found[0x400]), 3), 230.5)
    return f"{ROUNDS} times {len(wanted)} values"


async def saunum(bus: Bus) -> str:
    """It makes an asynchronous client by itself."""
    module = importlib.import_module("pysaunum.client")
    with patch.object(module, "AsyncModbusTcpClient", lambda **_: BusClient(bus)):
        sauna = await module.SaunumClient.create("192.0.2.1", device_id=16)
    for _ in range(ROUNDS):
        data = await sauna.async_get_data()
        check("degrees", (data.target_temperature, data.current_temperature), (80, 65))
    return f"{ROUNDS} times 18 values"


# For modbus-connection


def _unit(bus: Bus, address: int) -> Any:
    return importlib.import_module("rs485bus.compat.modbus_connection").BusConnection(bus).for_unit(address)


async def carlo_gavazzi(bus: Bus) -> str:
    """It recognises the meter by its code."""
    library = importlib.import_module("carlo_gavazzi_energy_meter_modbus")
    meter = await library.async_detect(_unit(bus, 17))
    for _ in range(ROUNDS):
        await meter.async_update_readings()
    return f"recognised {meter.model.name}, {ROUNDS} times all readings"


async def ecowitt(bus: Bus) -> str:
    """It pools what lies together."""
    station = importlib.import_module("ecowitt_ws90_modbus").WS90(_unit(bus, 0x90))
    for _ in range(ROUNDS):
        await station.async_update()
        check("degrees", round(station.sensors.temperature, 1), 26.2)
    await station.async_update_history()
    return f"{ROUNDS} times all sensors, the history"


async def brink(bus: Bus) -> str:
    """It reads settings and measurements of a ventilation unit."""
    unit = importlib.import_module("brink_flair_modbus").BrinkFlair(_unit(bus, 18), model_override=1)
    for _ in range(ROUNDS):
        await unit.async_update()
    return f"{ROUNDS} times all subsystems"


DRIVERS = [
    Driver("python-dcm230", "dcm230", "energy meter", 11, _at(0, *_float(48.5)) | _at(6, *_float(2.5)), dcm230),
    Driver("solaxx3", "solaxx3.solaxx3", "inverter", 1, _at(0, 2301, 2302, 2303), solaxx3),
    Driver("hm310t", "hm310t", "bench power supply", 13, {3: 3010, 5: 0x0233}, hm310t),
    Driver(
        "step-driver-g071-api", "step_driver_g071_api.step_driver", "stepper driver", 14, _at(9, 5000, 0), step_driver
    ),
    Driver(
        "bgetech-modbus",
        "bgetech_modbus.devices.ds100",
        "energy meter",
        15,
        _at(0x400, *divmod(230_500, 0x10000)),
        bgetech,
    ),
    Driver("pysaunum", "pysaunum", "sauna controller", 16, {4: 80, 100: 65}, saunum),
    Driver(
        "carlo-gavazzi-energy-meter-modbus",
        "carlo_gavazzi_energy_meter_modbus",
        "energy meter",
        17,
        {0xB: 341},
        carlo_gavazzi,
    ),
    Driver(
        "ecowitt-ws90-modbus",
        "ecowitt_ws90_modbus",
        "weather station",
        0x90,
        {0x160: 0x90, 0x161: 2, 0x162: 0x90, 0x167: 662, 0x168: 60, 0x16B: 150, 0x16D: 10010},
        ecowitt,
    ),
    Driver("brink-flair-modbus", "brink_flair_modbus", "ventilation unit", 18, {}, brink),
]


if __name__ == "__main__":
    sys.exit(main())
