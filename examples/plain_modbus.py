"""Plain Modbus to a foreign device beside the drives, directly and through pymodbus' own client methods.

python examples/plain_modbus.py                        # virtual drives
python examples/plain_modbus.py --port /dev/ttyUSB0 --baudrate 9600 --address 7
"""

import argparse
import asyncio

from rs485bus import Repeat, Urgency, open_bus
from rs485bus.compat import BusClient
from rs485bus.errors import DeviceRefused
from rs485bus.sim import SimUnit, VirtualLine
from rs485bus.wire.registers import I16, U16, Register

TEMPERATURE: Register[float] = Register("temperature", I16, "°C", step=0.1, address=4)
HUMIDITY: Register[float] = Register("humidity", U16, "%", step=0.1, address=5)


async def main(port: str | VirtualLine, baudrate: int, address: int) -> None:
    async with open_bus(port, baudrate=baudrate) as bus:
        sensor = bus.unit(address)
        print("registers 0..3:", await sensor.read_holding_registers(0, 4, urgency=Urgency.POLL))
        # Values of a table come in their own unit, and neighbours with one request.
        print("temperature and humidity:", await sensor.read(TEMPERATURE, HUMIDITY))
        # A write goes out once, unless it is said that it may be repeated.
        await sensor.write_register(2, 1234, repeat=Repeat.SAFE)
        try:
            await sensor.read_holding_registers(5000)
        except DeviceRefused as refused:
            print("refused with exception", refused.code)
        # A driver written for pymodbus' AsyncModbusSerialClient takes this instead, and shares the pair.
        client = BusClient(bus)
        print("register 2:", (await client.read_holding_registers(2, device_id=address)).registers[0])
        seen = bus.stats.units[address]
        print(f"{seen.requests} requests, {seen.retries} repeated, median {1000 * seen.latency(0.5):.1f} ms")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual drives")
    parser.add_argument("--baudrate", type=int, default=9600)
    parser.add_argument("--address", type=int, default=7)
    given = parser.parse_args()
    plant = VirtualLine(
        SimUnit(given.address, {register: 10 * register for register in range(8)}), baudrate=given.baudrate
    )
    asyncio.run(main(given.port or plant, given.baudrate, given.address))
