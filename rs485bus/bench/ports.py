"""The serial ports of this machine: what is plugged in, who holds it, and what slows it down."""

from __future__ import annotations

import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from rs485bus.transport.adapter import plugged_in
from rs485bus.transport.holders import others
from rs485bus.transport.permission import how_to_be_allowed

_BY_ID = Path("/dev/serial/by-id")
_TTY = Path("/sys/bus/usb-serial/devices")


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialPort:
    """One port."""

    port: str
    by_id: str | None
    """A name that stays the same wherever the adapter is plugged in."""
    description: str
    serial_number: str | None
    held_by: tuple[str, ...]
    """The programs that have it open."""
    latency_ms: int | None
    """Milliseconds for which the adapter may hold received bytes back; None where the system does not tell."""
    allowed: bool
    """Whether this user may open it."""
    advice: tuple[str, ...]
    """What to do before it is used."""

    def as_json(self) -> dict[str, object]:
        """For programs."""
        return asdict(self)


def serial_ports() -> list[SerialPort]:
    """The ports that are there. Those without an adapter behind them, as boards list by the dozen, are left out."""
    return [_look(port.device, port) for port in plugged_in() if port.vid is not None or not _is_bare(port.device)]


def _look(device: str, port: object) -> SerialPort:
    held = tuple(others(device))
    latency = _latency(device)
    allowed = sys.platform == "win32" or os.access(device, os.R_OK | os.W_OK)
    advice = []
    if not allowed:
        advice.append(how_to_be_allowed(device))
    if held:
        advice.append("close the other program, or have it share its bus")
    if latency is not None and latency > 1:
        timer = _TTY / Path(device).resolve().name / "latency_timer"
        advice.append(f"make it quicker: echo 1 | sudo tee {timer}")
    return SerialPort(
        port=device,
        by_id=_by_id(device),
        description=str(getattr(port, "description", None) or "serial port"),
        serial_number=getattr(port, "serial_number", None) or None,
        held_by=held,
        latency_ms=latency,
        allowed=allowed,
        advice=tuple(advice),
    )


def _by_id(device: str) -> str | None:
    try:
        links = sorted(_BY_ID.iterdir())
    except OSError:
        return None
    return next((str(link) for link in links if os.path.realpath(link) == os.path.realpath(device)), None)


def _latency(device: str) -> int | None:
    try:
        return int((_TTY / Path(device).resolve().name / "latency_timer").read_text())
    except (OSError, ValueError):
        return None


def _is_bare(device: str) -> bool:
    """Whether it is one of the ttyS that Linux lists whether there is one or not."""
    return Path(device).name.startswith("ttyS")
