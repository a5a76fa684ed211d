"""What was said of each job, held against what the slaves did. Pure."""

from __future__ import annotations

from rs485bus.bus.schedule.job import Outcome
from rs485bus.wire.registers import Repeat
from tests.endings.cable import Sent
from tests.endings.records import Asked
from tests.endings.slaves import Done, Memory, Mks, Slave


def untrue(asked: Asked, done: dict[Sent, list[Done]], slaves: dict[int, Slave]) -> str:
    """What is wrong with how a job ended; nothing if it is right.

    Args:
        asked: the job.
        done: what the slaves did, by the frame that they did it for.
        slaves: the slaves.
    """
    job, outcome = asked.job, asked.outcome
    came = [one for sent in asked.sent or () for one in done.get(sent, ())]
    carried_out = [one for one in came if not one.refused]
    refused = [one for one in came if one.refused or (one.code and not job.request.writes)]
    if job.is_broadcast:
        return "a broadcast not sent that was" if outcome is Outcome.NOT_SENT and asked.sent else ""
    if outcome is Outcome.REFUSED:
        if job.request.writes and carried_out:
            return "refused, and done"
        if not job.request.writes and all(one.code in (10, 11) for one in refused):
            return "a gateway's exception was taken for the unit's"
        return "" if refused else "a refusal that nobody gave"
    if outcome is Outcome.NOT_SENT:
        return "not sent, and done" if carried_out and job.request.writes else ""
    if outcome is Outcome.NO_REPLY and job.repeat is Repeat.NEVER and job.request.writes and asked.sent:
        return "no reply for what must not be repeated"
    if outcome is Outcome.NO_REPLY and job.repeat is Repeat.VERIFY:
        return "no reply for a write with a read-back"
    if outcome is not Outcome.REPLY:
        return ""
    if not carried_out:
        return "a reply, and not done"
    if not job.request.writes:
        return _misread(asked, slaves.get(job.address))
    return ""


def _misread(asked: Asked, slave: Slave | None) -> str:
    if slave is None:
        return "a reply of nobody"
    if isinstance(slave, Memory | Mks):
        return ""
    reply = asked.job.reply
    serial = int.from_bytes(reply[3:5], "big")
    stamp = slave.stamps.get(serial)
    if stamp is None or stamp.sent not in (asked.sent or ()):
        return "the answer to another request"
    return ""


def is_stop(frame: bytes) -> bool:
    """Whether a frame stops an MKS drive."""
    return frame[1:4] == b"\x06\x00\xf7" or (
        frame[1:3] == b"\x10\x00" and frame[3] in (0xF4, 0xF5, 0xF6) and frame[9:11] == b"\0\0"
    )
