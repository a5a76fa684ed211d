"""How a read-back tells whether a plain write was carried out, for each function that can be read back. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from rs485bus.bus.schedule.verification import Verification
from rs485bus.wire import functions
from rs485bus.wire.frames import HIGHEST_ADDRESS, Request, read_holding, registers


def mask_read_back(write: Request, and_mask: int, or_mask: int) -> Verification:
    """The bits of the register that the masks set or clear are so. The others may be anything."""
    read = read_holding(write.address, write.register, 1, HIGHEST_ADDRESS)
    return Verification(read, lambda reply: not (registers(reply)[0] ^ or_mask) & ~and_mask & 0xFFFF)


def coils_read_back(write: Request, values: Sequence[bool]) -> Verification:
    """The coils are as they were written."""
    wanted = [bool(value) for value in values]
    read = functions.read_coils(write.address, write.register, len(wanted), highest=HIGHEST_ADDRESS)
    return Verification(read, lambda reply: functions.bits(reply, len(wanted)) == wanted)


def files_read_back(write: Request, records: Sequence[tuple[int, int, Sequence[int]]]) -> Verification | None:
    """The records hold the values. None where a reply would not hold them all."""
    wanted = [list(values) for _, _, values in records]
    if sum(2 + 2 * len(values) for values in wanted) > functions.MAX_FILE_REPLY:
        return None
    places = [(file, record, len(values)) for file, record, values in records]
    read = functions.read_files(write.address, places, highest=HIGHEST_ADDRESS)
    return Verification(read, lambda reply: functions.file_records(reply) == wanted)
