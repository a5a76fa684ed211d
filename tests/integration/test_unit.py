"""Plain Modbus by `bus.unit`: every public function, private ones, what is refused before anything is sent."""

from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from rs485bus import BusConfig, MksServo, Repeat, open_bus
from rs485bus.bus.unit import Unit
from rs485bus.errors import DeviceRefused, NoReply, NotSent, OutcomeUnknown
from rs485bus.sim import ModbusData, Noise, SimMks, SimModbus, VirtualLine
from rs485bus.sim.device import SimDevice
from rs485bus.wire.diagnostics import DeviceInformation, EventCounter
from tests.integration.support import virtual

LONG = bytes(range(65, 65 + 26)) * 5


def device(address: int = 7) -> SimModbus:
    return SimModbus(
        address,
        ModbusData(
            coils={at: at % 3 == 0 for at in range(2000)},
            inputs={at: at % 2 == 0 for at in range(40)},
            registers={at: 100 + at for at in range(200)},
            input_registers={at: 1000 + at for at in range(200)},
            queues={30: [440, 4740]},
            files={4: {1: 0x0DFE, 2: 0x20}, 3: {9: 0x33CD, 10: 0x40}},
            identification={0: b"ACME", 1: b"RELAY-8", 2: b"V2.11", 3: LONG, 4: LONG, 0x80: LONG},
            server_id=b"\x07\xffRELAY",
            exception_status=0x6D,
        ),
    )


Call = Callable[[Unit], Coroutine[Any, Any, Any]]

ANSWERS: list[tuple[Call, Any]] = [
    (lambda unit: unit.read_coils(1, 4), [False, False, True, False]),
    (lambda unit: unit.read_coils(0), [True]),
    (lambda unit: unit.read_discrete_inputs(1, count=3), [False, True, False]),
    (lambda unit: unit.read_holding_registers(2, 2), [102, 103]),
    (lambda unit: unit.read_input_registers(address=2), [1002]),
    (lambda unit: unit.read_exception_status(), 0x6D),
    (lambda unit: unit.diag_query_data(b"\xa5\x37\x01"), b"\xa5\x37\x01"),
    (lambda unit: unit.diag_restart_communication(True), None),
    (lambda unit: unit.diag_read_diagnostic_register(), 1),
    (lambda unit: unit.diag_change_ascii_input_delimeter(), None),
    (lambda unit: unit.diag_clear_counters(), None),
    (lambda unit: unit.diag_read_bus_message_count(), 1),
    (lambda unit: unit.diag_read_bus_comm_error_count(), 1),
    (lambda unit: unit.diag_read_bus_exception_error_count(), 1),
    (lambda unit: unit.diag_read_device_message_count(), 1),
    (lambda unit: unit.diag_read_device_no_response_count(), 1),
    (lambda unit: unit.diag_read_device_nak_count(), 1),
    (lambda unit: unit.diag_read_device_busy_count(), 1),
    (lambda unit: unit.diag_read_bus_char_overrun_count(), 1),
    (lambda unit: unit.diag_read_iop_overrun_count(), 1),
    (lambda unit: unit.diag_clear_overrun_counter(), None),
    (lambda unit: unit.diag_get_comm_event_counter(), EventCounter(busy=False, events=1)),
    (lambda unit: unit.diag_get_comm_event_log(), (False, 1, 1, b"\x20\0")),
    (lambda unit: unit.report_device_id(), b"\x07\xffRELAY"),
    (lambda unit: unit.readwrite_registers(0, 3, 1, [7, 8]), [100, 7, 8]),
    (lambda unit: unit.read_fifo_queue(30), [440, 4740]),
    (lambda unit: unit.read_file_record([(4, 1, 2), (3, 9, 2)]), [[0x0DFE, 0x20], [0x33CD, 0x40]]),
    (lambda unit: unit.request(4, b"\0\x02\0\x01", reply="counted", writes=False), b"\x02\x03\xea"),
    (lambda unit: unit.request(4, b"\0\x02\0\x01", reply=3), b"\x02\x03\xea"),
    (lambda unit: unit.request(6, b"\0\x02\0\x01", reply="echo"), b"\0\x02\0\x01"),
    (lambda unit: unit.request(7, reply=lambda data: 1), b"\x6d"),
    (lambda unit: unit.request(4, b"\0\x02\0\x01", reply=lambda data: 1 + data[0]), b"\x02\x03\xea"),
    (lambda unit: unit.request(4, b"\0\x02\0\x01", reply=lambda data: 1 + {2: 2}[data[0]]), b"\x02\x03\xea"),
]


@pytest.mark.parametrize(("call", "expected"), ANSWERS)
@virtual
async def test_every_public_function_is_answered(call: Call, expected: Any) -> None:
    async with open_bus(VirtualLine(device()), config=BusConfig(echo=False)) as bus:
        assert await call(bus.unit(7)) == expected


@virtual
async def test_what_is_written_is_there() -> None:
    async with open_bus(VirtualLine(sim := device())) as bus:
        unit = bus.unit(7)
        await unit.write_coil(1, True)
        await unit.write_coils(4, [True, False, True] * 4)
        assert await unit.read_coils(0, 6) == [True, True, False, True, True, False]
        sim.data.registers[4] = 0x12
        await unit.mask_write_register(4, 0xF2, 0x25)
        assert sim.data.registers[4] == 0x17
        await unit.write_file_record([(4, 1, [1, 2]), (3, 9, [3])])
        assert (sim.data.files[4], sim.data.files[3][9]) == ({1: 1, 2: 2}, 3)
        await unit.write_register(5, 9)
        await unit.write_registers(6, [8, 7])
        assert await unit.read_holding_registers(5, 3) == [9, 8, 7]


@virtual
async def test_an_identification_is_read_to_its_end() -> None:
    async with open_bus(VirtualLine(sim := device())) as bus:
        basic = await bus.unit(7).read_device_information()
        assert (basic.vendor_name, basic.product_code, basic.revision) == ("ACME", "RELAY-8", "V2.11")
        assert basic.conformity == 0x83
        every = await bus.unit(7).read_device_information(3)
        assert every == DeviceInformation(0x83, sim.data.identification)
        assert len([pdu for pdu in sim.asked if pdu[:3] == b"\x2b\x0e\x03"]) == 3  # they do not fit one reply
        one = await bus.unit(7).read_device_information(4, 0x80)
        assert one[0x80] == LONG
        with pytest.raises(DeviceRefused, match="illegal register address"):
            await bus.unit(7).read_device_information(4, 0x81)


@virtual
async def test_an_identification_that_names_itself_as_the_next_one_ends() -> None:
    class Looping(SimDevice):
        def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
            return bytes((43, 14, 1, 1, 0xFF, pdu[3], 1, pdu[3], 1, 65))

    async with open_bus(VirtualLine(Looping(7))) as bus:
        assert (await bus.unit(7).read_device_information()).information == {0: b"A"}


@virtual
async def test_the_time_of_an_identification_is_for_all_of_it() -> None:
    async with open_bus(VirtualLine(device(), baudrate=9600)) as bus:
        began = bus.now()
        with pytest.raises((NotSent, NoReply), match=r"[Ii]ts time was over"):
            await bus.unit(7).read_device_information(3, timeout=0.2)
        assert bus.now() - began == pytest.approx(0.2)


@virtual
async def test_listen_only_returns_once_it_is_sent_and_the_device_is_silent_until_it_is_restarted() -> None:
    async with open_bus(VirtualLine(sim := device(), SimMks(1)), config=BusConfig(reply_timeout=0.05)) as bus:
        unit = bus.unit(7)
        await unit.read_coils(0)
        began = bus.now()
        await unit.diag_force_listen_only()
        assert sim.listens_only
        assert bus.now() - began < 0.15
        assert bus.stats.units[7].timeouts == 0
        with pytest.raises(NoReply):
            await unit.read_coils(0)
        with pytest.raises(OutcomeUnknown):
            await unit.diag_restart_communication()
        assert not sim.listens_only
        assert await unit.read_coils(0) == [True]
        assert await bus.unit(1).read_input_registers(0xF1) == [1]


@pytest.mark.parametrize(
    ("write", "lost"),
    [
        (lambda unit, **how: unit.write_coil(1, True, **how), b"\x05"),
        (lambda unit, **how: unit.write_coils(1, [True, True], **how), b"\x0f"),
        (lambda unit, **how: unit.write_register(1, 5, **how), b"\x06"),
        (lambda unit, **how: unit.mask_write_register(1, 0xFFF0, 0x05, **how), b"\x16"),
        (lambda unit, **how: unit.write_file_record([(4, 1, [5])], **how), b"\x15"),
    ],
)
@virtual
async def test_a_write_whose_reply_was_lost_is_settled_by_reading_back(write: Any, lost: bytes) -> None:
    class Mute(SimModbus):
        def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
            reply = super().answer(pdu, now, broadcast=broadcast)
            return None if pdu[:1] == lost else reply

    async with open_bus(VirtualLine(sim := Mute(7, device().data))) as bus:
        await write(bus.unit(7), repeat=Repeat.VERIFY)
        assert len([pdu for pdu in sim.asked if pdu[:1] == lost]) == 1
        sim.asked.clear()
        with pytest.raises(OutcomeUnknown):
            await write(bus.unit(7))
        assert len([pdu for pdu in sim.asked if pdu[:1] == lost]) == 1


@virtual
async def test_a_write_that_was_never_heard_is_repeated_once_a_read_back_has_told_so() -> None:
    class Deaf(SimModbus):
        heard = 0

        def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
            if pdu[0] == 15:
                self.heard += 1
                if self.heard == 1:
                    return None
            return super().answer(pdu, now, broadcast=broadcast)

    async with open_bus(VirtualLine(sim := Deaf(7, device().data))) as bus:
        await bus.unit(7).write_coils(1, [True, True], repeat=Repeat.VERIFY)
        assert sim.heard == 2
        assert sim.data.coils[1]
        assert sim.data.coils[2]


REFUSED: list[tuple[Callable[[Unit], Coroutine[Any, Any, Any]], str]] = [
    (lambda unit: unit.read_coils(0, 2001), r"count 2001 is outside 1\.\.2000"),
    (lambda unit: unit.read_coils(0, urgenc=1), r"urgenc= is none of pause=, repeat=, reply_timeout=, timeout="),  # type: ignore[call-arg]
    (lambda unit: unit.read_coils(0, reply_timeout=0), r"reply_timeout 0 s is outside 0\.001\.\.10 s"),
    (lambda unit: unit.read_coils(0, pause=-1), r"pause -1 s is outside 0\.\.1 s"),
    (lambda unit: unit.read_coils(0, pause="1"), "pause must be a number, not '1'"),  # type: ignore[arg-type]
    (lambda unit: unit.read_coils(0, repeat="often"), "repeat 'often' is none of"),  # type: ignore[arg-type]
    (lambda unit: unit.write_coils(0, "yes"), "coil value must be True or False, not 'y'"),  # type: ignore[arg-type]
    (lambda unit: unit.read_file_record([(1, 0, 200)]), "length 200 is outside"),
    (lambda unit: unit.diag_query_data(b""), "0 data bytes in one query"),
    (lambda unit: unit.diag_change_ascii_input_delimeter(300), r"delimiter 300 is outside 0\.\.255"),
    (lambda unit: unit.read_device_information(9), "read_code 9 is none of BASIC"),
    (lambda unit: unit.request(128, reply=1), r"function 128 is outside 1\.\.127"),
    (lambda unit: unit.request(65, reply="all"), "reply must be a number of bytes, 'counted', 'echo'"),  # type: ignore[arg-type]
    (lambda unit: unit.request(65, reply=253), r"reply 253 is outside 0\.\.252"),
    (lambda unit: unit.request(65, "12", reply=1), "data must be bytes, not '12'"),  # type: ignore[arg-type]
    (lambda unit: unit.request(65, bytes(253), reply=1), "a frame of 257 bytes"),
    (lambda unit: unit.request(65, reply=1, repeat=Repeat.VERIFY), "function 65 cannot be verified"),
    (lambda unit: unit.readwrite_registers(0, 1, 0, [1], repeat=Repeat.VERIFY), "function 23 cannot be verified"),
]


@pytest.mark.parametrize(("call", "said"), REFUSED)
@virtual
async def test_a_wrong_argument_is_told_before_anything_is_sent(call: Call, said: str) -> None:
    async with open_bus(VirtualLine(device())) as bus:
        with pytest.raises((ValueError, TypeError), match=said):
            await call(bus.unit(7))
        assert bus.stats.transactions == 0


@virtual
async def test_converters_are_at_hand() -> None:
    async with open_bus(VirtualLine(device())) as bus:
        unit = bus.unit(7)
        registers = unit.convert_to_registers(230.5, unit.DATATYPE.FLOAT32)
        await unit.write_registers(10, registers)
        assert unit.convert_from_registers(await unit.read_holding_registers(10, 2), unit.DATATYPE.FLOAT32) == 230.5


@virtual
async def test_a_drive_at_a_reserved_address_is_brought_back() -> None:
    lost = SimMks(1)
    lost.address = 250  # 8Bh takes it
    async with open_bus(VirtualLine(lost)) as bus:
        with pytest.raises(ValueError, match=r"address 250 is outside 1\.\.247"):
            bus.unit(250)
        unit = bus.unit(250, allow_reserved_address=True)
        assert await unit.read_input_registers(0xF1) == [1]
        await unit.write_register(0x8B, 2, repeat=Repeat.NEVER)
        assert await bus.unit(2).read_input_registers(0xF1) == [1]
        with pytest.raises(ValueError, match=r"address 256 is outside 1\.\.255"):
            bus.unit(256, allow_reserved_address=True)


@virtual
async def test_functions_reach_a_device_beside_a_moving_axis_on_a_bad_line() -> None:
    noise = Noise(lost_reply=0.02, flipped=0.02, foreign=0.02, stray=0.02, duplicated=0.02)
    async with open_bus(VirtualLine(SimMks(1), device(), noise=noise, seed=3)) as bus:
        x = MksServo(bus, 1)
        await x.enable()
        move = x.move_by(20.0)
        unit, wrong = bus.unit(7), 0
        for _ in range(100):
            wrong += await unit.read_coils(1, 9) != [at % 3 == 0 for at in range(1, 10)]
            wrong += await unit.read_fifo_queue(30) != [440, 4740]
            wrong += (await unit.read_device_information()).information != {0: b"ACME", 1: b"RELAY-8", 2: b"V2.11"}
            wrong += await unit.read_file_record([(4, 1, 2)]) != [[0x0DFE, 0x20]]
        assert not wrong
        assert await move == pytest.approx(20.0, abs=0.01)


@virtual
async def test_coils_and_masks_are_written_to_everybody_at_once() -> None:
    async with open_bus(VirtualLine(one := device(7), other := device(8))) as bus:
        await bus.broadcast.write_coil(1, True)
        await bus.broadcast.write_coils(4, [True, True])
        await bus.broadcast.mask_write_register(4, 0, 7)
        for sim in (one, other):
            assert [sim.data.coils[at] for at in (1, 4, 5)] == [True, True, True]
            assert sim.data.registers[4] == 7


@pytest.mark.parametrize(
    ("call", "change", "fresh"),
    [
        (lambda unit: unit.read_fifo_queue(30), lambda data: data.queues.update({30: [1, 2]}), [1, 2]),
        (lambda unit: unit.read_coils(0, 2), lambda data: data.coils.update({0: False, 1: True}), [False, True]),
        (lambda unit: unit.read_file_record([(4, 1, 1)]), lambda data: data.files[4].update({1: 7}), [[7]]),
        (lambda unit: unit.read_exception_status(), lambda data: setattr(data, "exception_status", 5), 5),
        (lambda unit: unit.report_device_id(), lambda data: setattr(data, "server_id", b"NEWER IT"), b"NEWER IT"),
        (lambda unit: unit.request(7, reply=1, writes=False), lambda data: setattr(data, "exception_status", 5), b"\5"),
    ],
)
@virtual
async def test_a_late_reply_of_any_function_is_taken_for_no_other(call: Call, change: Any, fresh: Any) -> None:
    config = BusConfig(reply_timeout=0.05, retries=0, echo=False)
    async with open_bus(VirtualLine(sim := device()), config=config) as bus:
        sim.turnaround = 0.3
        with pytest.raises(NoReply):
            await call(bus.unit(7))
        change(sim.data)
        sim.turnaround = None
        assert await call(bus.unit(7)) == fresh
        assert bus.stats.units[7].late_replies == 1
