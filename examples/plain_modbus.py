"""Plain Modbus to a foreign device beside the drives, directly and through pymodbus' own client methods.

python examples/plain_modbus.py                          # a virtual sensor
python examples/plain_modbus.py /dev/ttyUSB0 9600 7      # port, baud rate, address
"""

import asyncio
import sys

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
    if len(sys.argv) > 1:
        asyncio.run(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])))
    else:
        plant = VirtualLine(SimUnit(7, {register: 10 * register for register in range(8)}), baudrate=9600)
        asyncio.run(main(plant, 9600, 7))
