"""pymodbus' server. Usage: pymodbus_slave.py serial PORT | rtu-over-tcp NUMBER | tcp NUMBER"""

import asyncio
import sys

from pymodbus import FramerType, ModbusDeviceIdentification
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.server import StartAsyncSerialServer, StartAsyncTcpServer


def block(values: list[int]) -> ModbusSequentialDataBlock:
    return ModbusSequentialDataBlock(1, values)


device = ModbusDeviceContext(
    co=block([at % 3 == 0 for at in range(64)]),
    di=block([at % 2 == 0 for at in range(64)]),
    hr=block([500 + at for at in range(64)]),
    ir=block([900 + at for at in range(64)]),
)
identity = ModbusDeviceIdentification(
    info_name={"VendorName": "pymodbus", "ProductCode": "PM", "MajorMinorRevision": "3"}
)
context = ModbusServerContext(devices={5: device}, single=False)


async def main(kind: str, where: str) -> None:
    if kind == "serial":
        server = StartAsyncSerialServer(context, port=where, baudrate=115200, identity=identity)
    else:
        framer = FramerType.SOCKET if kind == "tcp" else FramerType.RTU
        address = ("127.0.0.1", int(where))
        server = StartAsyncTcpServer(context, address=address, framer=framer, identity=identity)
    serving = asyncio.ensure_future(server)
    await asyncio.sleep(0.3)
    print("ready", flush=True)
    await serving


asyncio.run(main(*sys.argv[1:]))
