"""All PDU classes of pymodbus, both ways: our requests read by its decoder, its replies read by ours.

Where both do not agree, the test says who is right. Seen with pymodbus 3.10 to 3.16.
"""

import copy
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu import bit_message as bit
from pymodbus.pdu import diag_message as diag
from pymodbus.pdu import file_message as file
from pymodbus.pdu import mei_message as mei
from pymodbus.pdu import other_message as other
from pymodbus.pdu import register_message as reg

from rs485bus.wire import diagnostics, functions
from rs485bus.wire.diagnostics import Diagnostic
from rs485bus.wire.frames import Request, from_pdu, read_holding, read_input, registers, write_multiple, write_single
from tests.wire.support import closed, listening

UNIT = 3
FILE = file.FileRecord(file_number=4, record_number=7, record_length=8)
RECORD = file.FileRecord(file_number=4, record_number=7, record_data=b"\6\xaf\4\xbe\x10\x0d\0\1")
INFORMATION = {0: b"Pymodbus", 1: b"PM", 2: b"3.16"}


class Case(NamedTuple):
    theirs: ModbusPDU
    ours: Request
    reply: ModbusPDU
    decode: Callable[[bytes], Any] = lambda _: None
    value: Any = None


def diagnostic(request: type[Any], reply: type[Any], subfunction: Diagnostic, sent: Any = 0, back: Any = 0) -> Case:
    data = sent if isinstance(sent, bytes) else int(sent)
    expected = back if isinstance(back, bytes) else int(back).to_bytes(2, "big")
    ours = diagnostics.diagnostic(UNIT, subfunction, data)
    return Case(request(message=sent), ours, reply(message=back), diagnostics.diagnostic_data, expected)


COUNTERS = [
    (diag.ReturnDiagnosticRegisterRequest, diag.ReturnDiagnosticRegisterResponse, Diagnostic.DIAGNOSTIC_REGISTER),
    (diag.ReturnBusMessageCountRequest, diag.ReturnBusMessageCountResponse, Diagnostic.BUS_MESSAGE_COUNT),
    (
        diag.ReturnBusCommunicationErrorCountRequest,
        diag.ReturnBusCommunicationErrorCountResponse,
        Diagnostic.BUS_COMM_ERROR_COUNT,
    ),
    (
        diag.ReturnBusExceptionErrorCountRequest,
        diag.ReturnBusExceptionErrorCountResponse,
        Diagnostic.BUS_EXCEPTION_ERROR_COUNT,
    ),
    (diag.ReturnDeviceMessageCountRequest, diag.ReturnDeviceMessageCountResponse, Diagnostic.DEVICE_MESSAGE_COUNT),
    (
        diag.ReturnDeviceNoResponseCountRequest,
        diag.ReturnDeviceNoResponseCountResponse,
        Diagnostic.DEVICE_NO_RESPONSE_COUNT,
    ),
    (diag.ReturnDeviceNAKCountRequest, diag.ReturnDeviceNAKCountResponse, Diagnostic.DEVICE_NAK_COUNT),
    (diag.ReturnDeviceBusyCountRequest, diag.ReturnDeviceBusyCountResponse, Diagnostic.DEVICE_BUSY_COUNT),
    (
        diag.ReturnDeviceBusCharacterOverrunCountRequest,
        diag.ReturnDeviceBusCharacterOverrunCountResponse,
        Diagnostic.BUS_CHAR_OVERRUN_COUNT,
    ),
    (diag.ReturnIopOverrunCountRequest, diag.ReturnIopOverrunCountResponse, Diagnostic.IOP_OVERRUN_COUNT),
]

CASES = [
    Case(
        bit.ReadCoilsRequest(address=19, count=24),
        functions.read_coils(UNIT, 19, 24),
        bit.ReadCoilsResponse(bits=[True] * 24),
        lambda reply: functions.bits(reply, 24),
        [True] * 24,
    ),
    Case(
        bit.ReadDiscreteInputsRequest(address=5, count=3),
        functions.read_discrete(UNIT, 5, 3),
        bit.ReadDiscreteInputsResponse(bits=[True, False, True]),
        lambda reply: functions.bits(reply, 3),
        [True, False, True],
    ),
    Case(
        reg.ReadHoldingRegistersRequest(address=1, count=2),
        read_holding(UNIT, 1, 2),
        reg.ReadHoldingRegistersResponse(registers=[1, 65535]),
        registers,
        [1, 65535],
    ),
    Case(
        reg.ReadInputRegistersRequest(address=1, count=1),
        read_input(UNIT, 1, 1),
        reg.ReadInputRegistersResponse(registers=[7]),
        registers,
        [7],
    ),
    Case(
        bit.WriteSingleCoilRequest(address=9, bits=[True]),
        functions.write_coil(UNIT, 9, True),
        bit.WriteSingleCoilResponse(address=9, bits=[True]),
    ),
    Case(
        reg.WriteSingleRegisterRequest(address=9, registers=[5]),
        write_single(UNIT, 9, 5),
        reg.WriteSingleRegisterResponse(address=9, registers=[5]),
    ),
    Case(
        bit.WriteMultipleCoilsRequest(address=9, bits=[True, False, True]),
        functions.write_coils(UNIT, 9, [True, False, True]),
        bit.WriteMultipleCoilsResponse(address=9, count=3),
    ),
    Case(
        reg.WriteMultipleRegistersRequest(address=9, registers=[5, 6]),
        write_multiple(UNIT, 9, [5, 6]),
        reg.WriteMultipleRegistersResponse(address=9, count=2),
    ),
    Case(
        reg.MaskWriteRegisterRequest(address=4, and_mask=0xF2, or_mask=0x25),
        functions.mask_write(UNIT, 4, 0xF2, 0x25),
        reg.MaskWriteRegisterResponse(address=4, and_mask=0xF2, or_mask=0x25),
    ),
    Case(
        reg.ReadWriteMultipleRegistersRequest(read_address=1, read_count=2, write_address=8, write_registers=[5]),
        functions.read_write(UNIT, 1, 2, 8, [5]),
        reg.ReadWriteMultipleRegistersResponse(registers=[3, 4]),
        registers,
        [3, 4],
    ),
    Case(
        file.ReadFifoQueueRequest(address=1246),
        functions.read_fifo(UNIT, 1246),
        file.ReadFifoQueueResponse(values=[440, 4740]),
        functions.fifo,
        [440, 4740],
    ),
    Case(
        file.ReadFileRecordRequest(records=[FILE]),
        functions.read_files(UNIT, [(4, 7, 4)]),
        file.ReadFileRecordResponse(records=[RECORD]),
        functions.file_records,
        [[0x06AF, 0x04BE, 0x100D, 1]],
    ),
    Case(
        file.WriteFileRecordRequest(records=[RECORD]),
        functions.write_files(UNIT, [(4, 7, [0x06AF, 0x04BE, 0x100D, 1])]),
        file.WriteFileRecordResponse(records=[RECORD]),
    ),
    Case(
        other.ReadExceptionStatusRequest(),
        diagnostics.exception_status(UNIT),
        other.ReadExceptionStatusResponse(status=0x6D),
        lambda reply: reply[2],
        0x6D,
    ),
    Case(
        other.GetCommEventCounterRequest(),
        diagnostics.event_counter(UNIT),
        other.GetCommEventCounterResponse(count=264, status=True),
        diagnostics.counted_events,
        (False, 264),
    ),
    Case(
        other.GetCommEventLogRequest(),
        diagnostics.event_log(UNIT),
        other.GetCommEventLogResponse(status=True, message_count=289, event_count=264, events=[0x20, 0]),
        diagnostics.logged_events,
        (False, 264, 289, b"\x20\0"),
    ),
    Case(
        other.ReportDeviceIdRequest(),
        diagnostics.server_id(UNIT),
        other.ReportDeviceIdResponse(identifier=b"Pymodbus"),
        lambda reply: reply[3:-2],
        b"Pymodbus\xff",
    ),
    Case(
        mei.ReadDeviceInformationRequest(read_code=1, object_id=0),
        diagnostics.identification(UNIT),
        mei.ReadDeviceInformationResponse(read_code=1, information=INFORMATION),
        diagnostics.identified,
        (0x83, None, INFORMATION),
    ),
    diagnostic(
        diag.ReturnQueryDataRequest, diag.ReturnQueryDataResponse, Diagnostic.QUERY_DATA, b"\xa5\x37", b"\xa5\x37"
    ),
    diagnostic(
        diag.RestartCommunicationsOptionRequest,
        diag.RestartCommunicationsOptionResponse,
        Diagnostic.RESTART_COMMUNICATION,
        0xFF00,
        0xFF00,
    ),
    diagnostic(
        diag.ChangeAsciiInputDelimiterRequest,
        diag.ChangeAsciiInputDelimiterResponse,
        Diagnostic.CHANGE_ASCII_DELIMITER,
        0x0A00,
        0x0A00,
    ),
    diagnostic(diag.ClearCountersRequest, diag.ClearCountersResponse, Diagnostic.CLEAR_COUNTERS),
    diagnostic(diag.ClearOverrunCountRequest, diag.ClearOverrunCountResponse, Diagnostic.CLEAR_OVERRUN_COUNTER),
    diagnostic(diag.GetClearModbusPlusRequest, diag.GetClearModbusPlusResponse, Diagnostic.MODBUS_PLUS, 4, 4),
    *(diagnostic(request, reply, subfunction, back=11) for request, reply, subfunction in COUNTERS),
]

by_class = pytest.mark.parametrize("case", CASES, ids=lambda case: type(case.theirs).__name__)


def of(pdu: ModbusPDU) -> bytes:
    """The frame of a PDU, which remembers how often it was encoded."""
    pdu = copy.deepcopy(pdu)
    return closed(bytes((UNIT, pdu.function_code)) + pdu.encode())


@by_class
def test_our_request_is_theirs_byte_for_byte_and_their_decoder_reads_it(case: Case) -> None:
    assert case.ours.adu == of(case.theirs)
    read = DecodePDU(True).decode(case.ours.adu[1:-2])
    assert type(read) is type(case.theirs)
    assert read is not None
    if isinstance(read, file.ReadFileRecordRequest):
        # Their server takes the registers asked for (6.14) for bytes: half of them are left, and odd numbers refused.
        assert read.records[0].record_length in (2, 4)
    else:
        assert read.encode() == copy.deepcopy(case.theirs).encode()


@by_class
def test_their_reply_is_found_and_read(case: Case) -> None:
    reply = of(case.reply)
    for request in (case.ours, from_pdu(UNIT, case.theirs, type(case.reply))):
        assert listening(request).feed(reply) == [("reply", reply)]
        assert listening(request).feed(b"\x55" + reply + reply) == [("reply", reply)] * 2
    assert case.decode(reply) == case.value
    assert DecodePDU(False).decode(reply[1:-2]) is not None


@by_class
def test_their_size_of_a_reply_is_right_but_for_two(case: Case) -> None:
    """A reply of function 24 is taken for two bytes shorter than it is: the CRC is not counted (6.18). That to a clear
    of the Modbus Plus statistics is taken for one that holds them."""
    reply = of(case.reply)
    missing = len(reply) - type(case.reply).calculateRtuFrameSize(reply)
    known = {file.ReadFifoQueueResponse: 2, diag.GetClearModbusPlusResponse: -110}
    assert missing in (0, known.get(type(case.reply), 0))


def test_listen_only_is_answered_by_nobody_there_too() -> None:
    assert of(diag.ForceListenOnlyModeRequest()) == diagnostics.diagnostic(UNIT, Diagnostic.FORCE_LISTEN_ONLY).adu
    assert not from_pdu(UNIT, diag.ForceListenOnlyModeRequest(), diag.ForceListenOnlyModeResponse).length


def test_the_statistics_of_modbus_plus_are_as_long_as_they_come() -> None:
    request = diagnostics.diagnostic(UNIT, Diagnostic.MODBUS_PLUS, 3)
    assert request.adu == of(diag.GetClearModbusPlusRequest(message=3))
    reply = of(diag.GetClearModbusPlusResponse(message=[3] + [0] * 55))
    assert listening(request).feed(reply) == [("reply", reply)]


def test_the_delimiter_is_the_first_of_its_two_bytes() -> None:
    """pymodbus sends 000A where nobody says which; 6.8.1 puts the character first, as its own server reads it."""
    assert diagnostics.ascii_delimiter(0x0A) == 0x0A00


def test_no_class_was_forgotten() -> None:
    decoder: Any = DecodePDU
    tables = getattr(decoder, "pdu_table", None)
    if tables is not None:
        classes = {pair[0] for pair in tables.values()}
        classes |= {pair[0] for table in decoder.pdu_sub_table.values() for pair in table.values()}
    else:
        classes = {pair[0] for pair in (*decoder._pdu_class_table, *decoder._pdu_sub_class_table)}
    named = {type(case.theirs) for case in CASES} | {diag.ForceListenOnlyModeRequest, diag.DiagnosticBase}
    assert {name for kind in classes if not (name := kind.__name__).startswith("_")} <= {
        kind.__name__ for kind in named
    }
