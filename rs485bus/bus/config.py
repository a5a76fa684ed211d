"""How a bus behaves. Validated once, when made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from serial.rs485 import RS485Settings

from rs485bus.arguments import flag, real, whole
from rs485bus.wire.timing import LineSettings

_PAIR_WINDOW, _GATEWAY_WINDOW = 0.5, 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BusConfig:
    """Settings of one bus; all times are seconds.

    Raises:
        ValueError, TypeError: a setting out of its range, or of a wrong type.
    """

    reply_timeout: float = 0.1
    """How long a device may take before its answer begins, after the request has left the wire. 0.001..10."""
    retries: int = 2
    """How often an unanswered request that may be repeated is sent again. 0..10. It is repeated for as long as so many
    attempts of `reply_timeout` take. A read without `timeout=` of a unit that is no drive, and was silent for longer
    than that the last time, is given up after one."""
    turnaround: float = 0.1
    """Silence after a broadcast. 0..2."""
    late_reply_window: float = _PAIR_WINDOW
    """How long after the end of its reply budget an unanswered request may still be answered. 0.05..10. It grows by
    itself, to 5 s, for a unit whose late reply came in its second half. Left as it is, it means 5 s behind a gateway,
    which may hold replies back."""
    in_order: bool = True
    """Replies of one unit come in the order in which it was asked, as bytes on one pair do. False for a line on which
    they may overtake each other: then a late reply is settled by the end of the window only, and a look by more equal
    answers than can be late. Not assumed behind gateways."""
    offline_after: int = 3
    """Unanswered requests in a row before which a device is never taken for offline. After them it is, once its silence
    is less likely than one in a billion for what the line loses: five attempts on a good one. 1..100."""
    max_queued: int = 20_000
    """Requests that may wait at once. 1..1,000,000."""
    echo: Literal["auto"] | bool = "auto"
    """Whether the adapter returns what is sent. "auto" finds out with the first frame, which is a read."""
    supervision: float = 0.25
    """How old what is known of an axis that may move becomes at most, where the wire has room for that. 0.05..5."""
    close_timeout: float = 5.0
    """How long closing may take to see every axis standing. 0.1..60."""
    foreign_watchdog: Literal["keep", "off"] = "keep"
    """What becomes of a watchdog that another program has left armed in a drive. "keep" leaves it as it is: it stops
    the motor whenever the drive is not asked for a while. "off" turns it off when the drive's facade is made; a drive
    that is shipped with its watchdog on loses that, too, until a watchdog block sets it."""
    leave_running: bool = False
    """Leave motors turning when the bus is closed without an error."""
    reopen_min: float = 0.1
    """First pause before a lost port is opened again."""
    reopen_max: float = 5.0
    """Longest pause before a lost port is opened again."""
    tcp_gap: float | None = None
    """Silence kept between frames where a gateway does the framing (RTU over TCP); None for t3.5 of the pair behind it.
    0..1."""
    silence: float | None = None
    """Silence between frames on a serial port; None for the 3.5 characters of Modbus (t3.5). Less is quicker, where it
    was measured on the bench that every device on the pair takes it; 1.5 characters at the least."""
    pipeline: int = 1
    """How many reads may be out at once over Modbus TCP (`tcp://`), 1..16. Behind a gateway one a unit, and a stop
    waits behind those that the gateway has taken. Only reads of plain units; motion never, and nothing at all while a
    watchdog is armed. No effect on other ports: what is on a pair can be told apart by nothing but its turn."""
    rs485_direction: bool | RS485Settings = False
    """Let the kernel switch the direction by RTS (TIOCSRS485), for ports wired so.

    True for RTS high while sending; `serial.rs485.RS485Settings(rts_level_for_tx=False, rts_level_for_rx=True,
    delay_before_tx=0.001)` for other wirings. Its delays are 0..0.1 s.
    """

    def __post_init__(self) -> None:
        _within("reply_timeout", self.reply_timeout, 0.001, 10)
        whole("retries", self.retries, 0, 10)
        _within("turnaround", self.turnaround, 0, 2)
        _within("late_reply_window", self.late_reply_window, 0.05, 10)
        whole("offline_after", self.offline_after, 1, 100)
        whole("max_queued", self.max_queued, 1, 1_000_000)
        _within("supervision", self.supervision, 0.05, 5)
        _within("close_timeout", self.close_timeout, 0.1, 60)
        _within("reopen_max", self.reopen_max, 0.01, 60)
        _within("reopen_min", self.reopen_min, 0.01, self.reopen_max)
        if self.tcp_gap is not None:
            _within("tcp_gap", self.tcp_gap, 0, 1)
        whole("pipeline", self.pipeline, 1, 16)
        if self.silence is not None:
            _within("silence", self.silence, 0, 1)
        if self.echo not in ("auto", True, False):
            raise ValueError(f"echo {self.echo!r} is none of 'auto', True, False")
        if self.foreign_watchdog not in ("keep", "off"):
            raise ValueError(f"foreign_watchdog {self.foreign_watchdog!r} is neither 'keep' nor 'off'")
        flag("in_order", self.in_order)
        flag("leave_running", self.leave_running)
        if isinstance(self.rs485_direction, RS485Settings):
            _within("delay_before_tx", self.rs485_direction.delay_before_tx or 0.0, 0, 0.1)
            _within("delay_before_rx", self.rs485_direction.delay_before_rx or 0.0, 0, 0.1)
        else:
            flag("rs485_direction", self.rs485_direction)

    def silence_on(self, line: LineSettings, gateway: bool) -> float:
        """Seconds of silence between frames on a pair, or on the way to a gateway.

        Raises:
            ValueError: it is less than 1.5 characters, or a gateway keeps it.
        """
        if self.silence is None:
            return self.tcp_gap if gateway and self.tcp_gap is not None else line.t35
        if gateway:
            raise ValueError(
                "silence is for serial ports: a gateway keeps its own. What is left between two is tcp_gap"
            )
        if self.silence < line.shortest_silence:
            raise ValueError(
                f"silence {self.silence:g} s is less than 1.5 characters at {line.baudrate} bit/s "
                f"({line.shortest_silence:.6f} s): devices could not tell where a frame ends"
            )
        return self.silence

    def late_reply_window_of(self, gateway: bool) -> float:
        """The late reply window of a pair, or of what is behind a gateway."""
        return _GATEWAY_WINDOW if gateway and self.late_reply_window == _PAIR_WINDOW else self.late_reply_window


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= real(name, value) <= high:
        raise ValueError(f"{name} {value} is outside {low:g}..{high:g}")
