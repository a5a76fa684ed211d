"""A paced line on a pseudo-terminal, in a process of its own: every byte takes its airtime, every silence is checked.

    python -m benchmarks.line '{"baudrate": 115200}'

It answers functions 3, 4, 6 and 16 for every address and hands each reply over when the airtime of its last byte is
over, which is what a client waits for. It spins, so that it is late by microseconds only; it needs a core of its own.
Prints the port's path; on SIGTERM it prints what it counted.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import pty
import select
import signal
import statistics
import sys
import time
import tty
from collections import deque
from dataclasses import dataclass

from benchmarks.orphans import end_with_parent
from benchmarks.setting import MARK, Setting
from rs485bus.wire.frames import crc

_KEPT = 5000


@dataclass(slots=True)
class Reply:
    """A reply on its way. Times are nanoseconds of the monotonic clock."""

    frame: bytes
    starts: int
    ends: int


class PacedLine:
    """The line and the units on it. Times are nanoseconds of the monotonic clock.

    Args:
        setting: how it is set.
        spin: watch for bytes without pause; otherwise up to a millisecond late.
    """

    def __init__(self, setting: Setting, *, spin: bool = True) -> None:
        line = setting.line
        self._character = round(line.character * 1e9)
        self._silence = round(line.t35 * 1e9)
        self._turnaround = round(setting.turnaround * 1e9)
        self._spin = spin
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._poller = select.poll()
        self._poller.register(self._master, select.POLLIN)
        self.port = os.ttyname(self._slave)
        self.stopped = False
        self.frames = 0
        self.early = 0
        """Frames that began before t3.5 of silence."""
        self.marks: list[tuple[float, int]] = []
        """When a write to `MARK` arrived, in seconds, and its first value."""
        self._buffer = b""
        self._air_end = 0
        self._quiet_since = 0
        self._replies: deque[Reply] = deque()
        self._excess: deque[int] = deque(maxlen=_KEPT)
        self._late: deque[int] = deque(maxlen=_KEPT)

    def run(self) -> None:
        """Serve until `stopped` is set."""
        poll, clock, replies = self._poller.poll, time.monotonic_ns, self._replies
        while not self.stopped:
            if replies and replies[0].ends <= clock():
                self._hand_over(replies.popleft())
            if self._spin:
                os.sched_yield()  # to the kernel's worker that hands bytes over: it would wait 3 ms for this core
            if poll(0 if self._spin else self._pause()):
                now = clock()
                self.heard(os.read(self._master, 4096), now)

    def heard(self, data: bytes, now: int) -> None:
        """The client sends."""
        if self._buffer and now - self._air_end > self._silence:
            self._buffer = b""  # what is torn is not continued after a silence
        if not self._buffer:
            self._begin(now)
        self._buffer += data
        self._air_end = max(self._air_end, now) + len(data) * self._character
        self._quiet_since = max(self._quiet_since, self._air_end)
        length = _length(self._buffer)
        while length and len(self._buffer) >= length:
            frame, self._buffer = self._buffer[:length], self._buffer[length:]
            self._ask(frame, now)
            length = _length(self._buffer)

    def counted(self) -> dict[str, object]:
        """What the line counted, with the median times it was kept waiting and was late itself, in microseconds."""
        return {
            "frames": self.frames,
            "early": self.early,
            "excess_us": _microseconds(self._excess, 0.5),
            "excess_p90_us": _microseconds(self._excess, 0.9),
            "late_us": _microseconds(self._late, 0.5),
            "late_p99_us": _microseconds(self._late, 0.99),
            "marks": self.marks,
        }

    def close(self) -> None:
        os.close(self._master)
        os.close(self._slave)

    def _begin(self, now: int) -> None:
        """A frame begins."""
        self.frames += 1
        talking = bool(self._replies) and self._replies[0].starts < now
        silence = 0 if talking else now - self._quiet_since
        if self._quiet_since:
            self.early += silence < self._silence
            self._excess.append(silence - self._silence)

    def _ask(self, frame: bytes, arrived: int) -> None:
        if crc(frame[:-2]) != frame[-2:] or frame[0] == 0:
            return
        register = int.from_bytes(frame[2:4], "big")
        if frame[1] == 16 and register == MARK:
            self.marks.append((arrived / 1e9, int.from_bytes(frame[7:9], "big")))
        self.answer(frame, self._air_end + self._turnaround)

    def answer(self, frame: bytes, starts: int) -> None:
        """A unit was asked; its reply usually begins at `starts`."""
        body = frame[:-2]
        if frame[1] in (3, 4):
            count = frame[5]
            body = frame[:2] + bytes((2 * count,)) + b"\0\1" * count
        elif frame[1] == 16:
            body = frame[:6]
        self.reply(body, starts)

    def reply(self, body: bytes, starts: int) -> None:
        """A unit begins to answer at `starts`."""
        reply = body + crc(body)
        self._replies.append(Reply(reply, starts, starts + len(reply) * self._character))

    def _hand_over(self, reply: Reply) -> None:
        now = time.monotonic_ns()
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, reply.frame)
        self._quiet_since = max(self._quiet_since, now)
        self._late.append(now - reply.ends)

    def _pause(self) -> int:
        """Milliseconds that may be slept."""
        if not self._replies:
            return 20
        return max(0, (self._replies[0].ends - time.monotonic_ns()) // 1_000_000 - 1)


def _length(buffer: bytes) -> int:
    """How long the request is that the buffer begins with; 0 if it is too short to tell."""
    if len(buffer) < 7:
        return 0
    return 9 + buffer[6] if buffer[1] == 16 else 8


def _microseconds(times: deque[int], quantile: float) -> float:
    if len(times) < 2:
        return 0.0
    return round(statistics.quantiles(times, n=100)[round(100 * quantile) - 1] / 1000, 1)


def main() -> None:
    end_with_parent()
    options = json.loads(sys.argv[1])
    core = options.pop("core", None)
    if core is not None:
        os.sched_setaffinity(0, {core})
    serve(PacedLine(Setting(**options), spin=core is not None))


def serve(line: PacedLine) -> None:
    """Serve until SIGTERM; print the port's path first, and at the end what was counted."""

    def stop(*_: object) -> None:
        line.stopped = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    print(json.dumps({"port": line.port}), flush=True)
    gc.disable()
    line.run()
    print(json.dumps(line.counted()), flush=True)


if __name__ == "__main__":
    main()
