"""The whole face of pymodbus' clients: what drivers call beside requests, and what older ones call."""

import struct
import warnings
from typing import Any

import pytest
from pymodbus.client import AsyncModbusSerialClient
from pymodbus.client.mixin import ModbusClientMixin
from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException, ParameterException
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.file_message import FileRecord

from rs485bus import Bus, BusConfig, open_bus
from rs485bus.compat import BroadcastRefused, BusClient, RequestRefused, SyncBusClient
from rs485bus.sim import ModbusData, SimModbus, VirtualLine
from rs485bus.sim.device import SimDevice
from tests.integration.support import virtual


def device(address: int = 7) -> SimModbus:
    registers = {at: 100 + at for at in range(32)}
    coils = {at: at % 3 == 0 for at in range(64)}
    data = ModbusData(coils, coils, registers, registers, {30: [440, 4740]}, {4: {1: 0x0DFE, 2: 0x20}}, {0: b"ACME"})
    return SimModbus(address, data)


@virtual
async def test_every_function_of_pymodbus_is_answered_in_its_terms() -> None:
    async with open_bus(VirtualLine(device())) as bus:
        client: Any = BusClient(bus)
        at = {"device_id": 7}
        assert (await client.read_coils(0, count=4, **at)).bits[:4] == [True, False, False, True]
        assert (await client.read_discrete_inputs(1, count=3, **at)).bits[:3] == [False, False, True]
        assert (await client.read_holding_registers(2, count=2, **at)).registers == [102, 103]
        assert (await client.read_input_registers(2, count=2, **at)).registers == [102, 103]
        assert not (await client.write_coil(1, True, **at)).isError()
        assert not (await client.write_coils(2, [True, True, False], **at)).isError()
        assert (await client.read_coils(0, count=5, **at)).bits[:5] == [True, True, True, True, False]
        assert (await client.write_register(3, 9, **at)).registers == [9]
        assert (await client.write_registers(4, [8, 7], **at)).count == 2
        assert (await client.mask_write_register(address=3, and_mask=0xFFFE, or_mask=0, **at)).or_mask == 0
        both = await client.readwrite_registers(read_address=3, read_count=2, write_address=4, values=[5], **at)
        assert both.registers == [8, 5]
        assert (await client.read_fifo_queue(address=30, **at)).values == [440, 4740]
        files = await client.read_file_record([FileRecord(file_number=4, record_number=1, record_length=4)], **at)
        assert files.records[0].record_data == b"\x0d\xfe\0\x20"
        written = [FileRecord(file_number=4, record_number=1, record_data=b"\0\1")]
        assert not (await client.write_file_record(written, **at)).isError()
        assert (await client.read_exception_status(**at)).status == 0
        assert (await client.diag_query_data(b"\x12\x34", **at)).message == b"\x12\x34"
        assert (await client.diag_read_bus_message_count(**at)).message > 10
        assert (await client.diag_get_comm_event_counter(**at)).count > 10
        assert (await client.diag_get_comm_event_log(**at)).events == [0x20, 0]
        assert not (await client.report_device_id(**at)).isError()
        assert (await client.read_device_information(**at)).information == {0: b"ACME"}
        assert (await client.read_coils(1000, **at)).exception_code == 2


@virtual
async def test_a_client_shows_what_pymodbus_shows_of_a_connection() -> None:
    async with open_bus(VirtualLine(device(), baudrate=38400, parity="E")) as bus:
        client = BusClient(bus)
        params = client.comm_params
        assert (params.baudrate, params.parity, params.stopbits, params.bytesize) == (38400, "E", 1, 8)
        assert params.timeout_connect == bus.config.reply_timeout
        assert client.ctx.comm_params is params
        assert client.ctx.is_active()
        assert client.ctx.transport is not None
        client.set_max_no_responses(7)
        assert client.ctx.max_until_disconnect == 7
        assert str(client) == f"BusClient {bus.port}"
        assert (await client.ctx.execute(False, _request(7))).registers == [100]
        theirs = {name for name in dir(AsyncModbusSerialClient) if not name.startswith("_")}
        assert theirs <= set(dir(client))


def _request(device_id: int) -> ModbusPDU:
    from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

    return ReadHoldingRegistersRequest(address=0, count=1, dev_id=device_id)


@virtual
async def test_who_traces_is_told_of_each_frame_and_pdu() -> None:
    async with open_bus(VirtualLine(device())) as bus:
        client, told = BusClient(bus), []
        client.ctx.trace_packet = lambda sending, data: told.append((sending, data[:2].hex())) or data  # type: ignore[func-returns-value]
        client.ctx.trace_pdu = lambda sending, pdu: told.append((sending, type(pdu).__name__)) or pdu  # type: ignore[func-returns-value]
        await client.read_coils(0, device_id=7)
        assert told == [
            (True, "ReadCoilsRequest"),
            (True, "0701"),
            (False, "0701"),
            (False, "ReadCoilsResponse"),
        ]
        assert client.ctx.getNextTID() == 0
        assert client.ctx.loop is bus.loop


@virtual
async def test_a_client_that_was_closed_sends_nothing_until_it_is_connected_and_closes_no_bus() -> None:
    async with open_bus(VirtualLine(device())) as bus:
        client, other = BusClient(bus), BusClient(bus)
        client.close()
        assert not client.connected
        assert client.ctx.transport is None
        with pytest.raises(ConnectionException):
            await client.read_coils(0, device_id=7)
        assert other.connected
        assert not (await other.read_coils(0, device_id=7)).isError()
        assert await client.connect()
        assert not (await client.read_coils(0, device_id=7)).isError()


@virtual
async def test_arguments_of_older_versions_do_and_say_their_age() -> None:
    async with open_bus(VirtualLine(sim := device())) as bus:
        client: Any = BusClient(bus)
        with pytest.warns(DeprecationWarning, match=r"slave= is called device_id= since pymodbus 3\.10"):
            assert (await client.read_holding_registers(2, count=2, slave=7)).registers == [102, 103]
        with pytest.warns(DeprecationWarning, match="unit= is called device_id="):
            assert not (await client.write_register(2, 5, unit=7)).isError()
        with pytest.warns(DeprecationWarning, match=r"read_input_registers\(\) takes count by keyword"):
            assert (await client.read_input_registers(2, 2, device_id=7)).registers == [5, 103]
        with pytest.warns(DeprecationWarning, match="takes count and device_id by keyword"):
            assert (await client.read_coils(0, 3, 7)).bits[:3] == [True, False, False]
        with pytest.warns(DeprecationWarning, match=r"report_slave_id\(\) is called report_device_id\(\)"):
            assert not (await client.report_slave_id(device_id=7)).isError()
        assert not (await client.execute(_request(7))).isError()  # as before pymodbus 3.8
        asked = len(sim.asked)
        with pytest.raises(TypeError, match="slave= and device_id=, which are the same"):
            client.read_coils(0, slave=7, device_id=7)
        with pytest.raises(TypeError, match="got count twice"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            client.read_coils(0, 3, count=3)
        with pytest.raises(TypeError):
            client.read_coils(0, 3, 7, False, "more")
        with pytest.raises(TypeError):
            client.read_coils(0, slaves=7)
        assert len(sim.asked) == asked


@pytest.mark.parametrize(
    "call",
    [
        lambda client: client.read_holding_registers(70000, device_id=7),
        lambda client: client.read_holding_registers(-1, device_id=7),
        lambda client: client.read_holding_registers(0, count=0, device_id=7),
        lambda client: client.read_holding_registers(0, count=126, device_id=7),
        lambda client: client.read_holding_registers("0", device_id=7),
        lambda client: client.read_holding_registers(0, device_id=248),
        lambda client: client.read_holding_registers(0, device_id=-1),
        lambda client: client.write_register(70000, 1, device_id=7),
        lambda client: client.write_register(0, 70000, device_id=7),
        lambda client: client.write_registers(0, [1] * 200, device_id=7),
        lambda client: client.write_registers(0, [70000], device_id=7),
        lambda client: client.write_coil(70000, True, device_id=7),
        lambda client: client.read_fifo_queue(address=70000, device_id=7),
        lambda client: client.read_device_information(read_code=300, device_id=7),
    ],
)
@virtual
async def test_what_no_frame_can_say_is_pymodbus_own_exception_and_a_value_error(call: Any) -> None:
    async with open_bus(VirtualLine(device())) as bus:
        with pytest.raises(RequestRefused, match="Nothing was sent") as caught:
            await call(BusClient(bus))
        assert isinstance(caught.value, ParameterException)
        assert isinstance(caught.value, ValueError)
        assert bus.stats.transactions == 0


@virtual
async def test_an_id_that_is_no_byte_is_pymodbus_own_exception() -> None:
    async with open_bus(VirtualLine(device())) as bus:
        with pytest.raises(ModbusException):
            await BusClient(bus).read_holding_registers(0, device_id=256)
        with pytest.raises(BroadcastRefused):
            await BusClient(bus).read_holding_registers(0, device_id=0)


@virtual
async def test_a_reserved_address_is_reached_where_it_is_allowed() -> None:
    sim = device()
    sim.address = 250
    async with open_bus(VirtualLine(sim)) as bus:
        assert not (await BusClient(bus, allow_reserved_address=True).read_coils(0, device_id=250)).isError()


# Functions that pymodbus does not know


class Custom(ModbusPDU):
    """As pymodbus' page on custom messages makes one."""

    function_code = 55
    rtu_byte_count_pos = 2

    def __init__(self, values: Any = None, dev_id: int = 1, transaction_id: int = 0) -> None:
        super().__init__(dev_id=dev_id, transaction_id=transaction_id)
        self.values = values or []

    def encode(self) -> bytes:
        return struct.pack(">HH", self.address, 16)

    def decode(self, data: bytes) -> None:
        self.values = list(struct.unpack(f">{data[0] // 2}H", data[1:]))


class Unsized(Custom):
    rtu_byte_count_pos = 0


class Raising(Custom):
    rtu_byte_count_pos = 0

    @classmethod
    def calculateRtuFrameSize(cls, data: bytes) -> int:  # noqa: N802 # pymodbus' name
        return int(struct.unpack_from(">B", data, 2)[0]) + 5

    def decode(self, data: bytes) -> None:
        raise KeyError(data)


class Special(SimDevice):
    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        return bytes((pdu[0], 4, 0, 1, 0, 2))


@virtual
async def test_a_registered_reply_is_decoded_by_its_class_for_that_client_alone() -> None:
    async with open_bus(VirtualLine(Special(7)), config=BusConfig(echo=False)) as bus:
        client = BusClient(bus)
        with pytest.raises(RequestRefused, match=r"function 55 is not known to pymodbus: register\(\)"):
            await client.execute(False, Custom(dev_id=7))
        client.register(Custom)
        reply = await client.execute(False, Custom(dev_id=7))
        assert isinstance(reply, Custom)
        assert reply.values == [1, 2]
        with pytest.raises(RequestRefused, match="not known"):
            await BusClient(bus).execute(False, Custom(dev_id=7))


@virtual
async def test_a_class_that_is_no_use_is_said_and_never_stops_the_bus() -> None:
    async with open_bus(VirtualLine(Special(7)), config=BusConfig(retries=0, echo=False)) as bus:
        client = BusClient(bus)
        client.register(Unsized)
        with pytest.raises(RequestRefused, match="Unsized does not say how long its frame is: give it rtu_frame_size"):
            await client.execute(False, Unsized(dev_id=7))
        client.register(Raising)
        with pytest.raises(ModbusIOException, match="could not be decoded"):
            await client.execute(False, Raising(dev_id=7))
        assert bus.connected


def test_both_clients_have_every_method_of_pymodbus_mixin() -> None:
    for name in dir(ModbusClientMixin):
        assert hasattr(BusClient, name)
        assert hasattr(SyncBusClient, name)


@virtual
async def test_an_unanswered_request_names_its_function() -> None:
    async def code(bus: Bus) -> int | None:
        with pytest.raises(ModbusIOException) as caught:
            await BusClient(bus, reply_timeout=0.01).read_coils(0, device_id=9)
        return caught.value.fcode

    async with open_bus(VirtualLine(device())) as bus:
        assert await code(bus) == 1
