"""An exchange in words: what was asked, what was answered, what was wrong. Pure."""

from __future__ import annotations

from typing import Literal, NamedTuple

from rs485bus.bus.capture_lines import Exchange
from rs485bus.capture.pdu import Spoken, bare, bits, refusal, spoken, told
from rs485bus.capture.vocabulary import VOCABULARIES, Value, said
from rs485bus.devices.mks.frames import is_native
from rs485bus.wire.answers import MASK_WRITE
from rs485bus.wire.frames import BROADCAST

Purpose = Literal["stop", "start", "feed", "confirm", "command", "poll"]

_NOT_ANSWERED = {
    "no reply": "NO REPLY",
    "cut": "CUT for a stop",
    "lost": "PORT LOST",
    "broadcast": "broadcast",
    "sent": "sent, not answered by design",
}

_SHORTEST = 4
_FEW = 3
"""Names that are all told where they are asked for; the answer tells all of them anyway."""


class Words(NamedTuple):
    """An exchange in words."""

    asked: str
    answered: str
    error: bool
    purpose: Purpose
    """What it was sent for. Where the capture does not say: "stop" for a write that stops a drive of the family,
    "poll" for a read, and "command" for all else."""


def words_of(exchange: Exchange, family: str | None) -> Words:
    """Say an exchange in words. `family` names the drive's family, where it is known."""
    if 0 < len(exchange.request) < _SHORTEST:
        return Words(f"{exchange.request.hex(' ').upper()} (no whole request)", exchange.outcome, True, "command")
    if not exchange.request:
        return Words("(nobody asked)", f"{exchange.reply.hex(' ').upper()}", True, "command")
    if is_native(exchange.request[1], exchange.request):
        return Words(f"MKS' own protocol: {exchange.request.hex(' ').upper()}", "", False, "command")
    asked = spoken(exchange.request)
    return Words(_request(asked, family), *_answer(exchange, asked, family), purpose=_purpose(exchange, asked, family))


def values_of(exchange: Exchange, family: str | None) -> list[Value]:
    """The registers of a known drive that an exchange read or wrote, with their values; empty if it failed."""
    vocabulary = VOCABULARIES.get(family or "")
    if vocabulary is None or len(exchange.request) < _SHORTEST or exchange.outcome != "reply":
        return []
    asked = spoken(exchange.request)
    return vocabulary.names(asked, asked.data or told(asked, exchange.reply)) or []


def _request(asked: Spoken, family: str | None) -> str:
    vocabulary = VOCABULARIES.get(family or "")
    names = None if vocabulary is None else vocabulary.names(asked, asked.data)
    if names and asked.verb == "read" and len(names) > _FEW:
        return f"read {names[0]} ... {names[-1]} ({asked.count} registers at 0x{asked.register:02X})"
    if names:
        return f"{asked.verb} {', '.join(map(str, names))}"
    data = bare(asked, asked.data)
    return f"{asked.what} = {data}" if data else asked.what


def _answer(exchange: Exchange, asked: Spoken, family: str | None) -> tuple[str, bool]:
    """The answer in words, and whether it is an error."""
    reply, outcome = exchange.reply, exchange.outcome
    if outcome in _NOT_ANSWERED and not reply:
        return _NOT_ANSWERED[outcome], exchange.failed
    if why := refusal(asked, reply):
        return f"REFUSED: {why}", True
    vocabulary = VOCABULARIES.get(family or "")
    if outcome == "refused" and vocabulary is not None and vocabulary.refused_stop and vocabulary.is_stop(asked):
        return vocabulary.refused_stop, False
    if outcome == "refused":
        return "REFUSED inside a normal reply", True
    data = told(asked, reply)
    if data:
        names = None if vocabulary is None else vocabulary.names(asked, data)
        # What a read of one value was about stands before the answer.
        one = names[0] if names and len(names) == 1 else None
        text = said(one.value, one.unit) if one else ", ".join(map(str, names)) if names else bare(asked, data)
    elif asked.verb == "write" or asked.function == MASK_WRITE:
        text = "done"
    else:
        text = bits(asked, reply) or reply[2:-2].hex(" ").upper()
    return text, exchange.failed


def _purpose(exchange: Exchange, asked: Spoken, family: str | None) -> Purpose:
    if exchange.urgency in ("stop", "start", "feed", "confirm", "command", "poll"):
        return exchange.urgency  # type: ignore[return-value] # one of them, as was just looked at
    families = (
        VOCABULARIES.values() if exchange.address == BROADCAST else filter(None, [VOCABULARIES.get(family or "")])
    )
    if any(vocabulary.is_stop(asked) for vocabulary in families):
        return "stop"
    return "poll" if asked.verb == "read" else "command"
