"""A virtual RS-485 pair: bytes take their time, and who breaks the rules of the wire is not understood. Pure.

A frame that starts before t3.5 of silence is not understood and counted; two that talk at once destroy each other's
bytes. `VirtualPair` is told the time; `VirtualLine` puts it under an event loop.
"""

from __future__ import annotations

import heapq
import itertools
import random
from collections.abc import Callable, Iterator

from rs485bus.sim.device import SimDevice
from rs485bus.sim.noise import Noise
from rs485bus.sim.treatment import PLAIN, Treatment
from rs485bus.wire.frames import BROADCAST, crc
from rs485bus.wire.timing import LineSettings

_EPSILON = 1e-6
_STOP_WAITS = 0.02
"""Seconds without silence after which a stop, and the read that confirms it, goes out all the same."""
_PIECE = 0.001
"""Seconds of airtime that arrive at once, as from a receiver with a small buffer."""


class _Talk:
    """A device that talks."""

    __slots__ = ("destroyed", "until")

    def __init__(self, until: float) -> None:
        self.until = until
        self.destroyed = False


class VirtualPair:
    """The pair and the devices on it.

    Args:
        devices: what hangs on it.
        line: how characters travel.
        noise: what goes wrong.
        seed: makes the noise reproducible.
        turnaround: seconds the devices take before they answer, where they have no time of their own.
    """

    def __init__(
        self,
        devices: tuple[SimDevice, ...],
        line: LineSettings,
        noise: Noise,
        seed: int,
        turnaround: float = 0.002,
    ) -> None:
        self.devices = list(devices)
        self.line = line
        self.noise = noise
        self.turnaround = turnaround
        self.lenient = False
        """Understand frames that start too early. They are counted all the same."""
        self.frames = 0
        """Frames the master sent."""
        self.early_frames = 0
        """Frames that started before t3.5 of silence, as far as the master could hear it."""
        self.frames_over_noise = 0
        """Those that did after no silence for so long that a stop waits no longer. They are not counted as early."""
        self.usable_silence = line.t35
        """Seconds of silence that the master waits for."""
        self.collisions = 0
        """Times that two talked at once."""
        self.ears: list[Callable[[bytes, float], None]] = []
        """Who else listens: called with a few bytes, whoever sent them, and the time."""
        self.script: Callable[[bytes, float], Treatment] | None = None
        """Says what becomes of each whole frame, beside the noise."""
        self._rng = random.Random(seed)
        self._events: list[tuple[float, int, Callable[[float], None]]] = []
        self._number = itertools.count()
        self._received: list[bytes] = []
        self._frame = bytearray()
        self._spoilt = False
        self._silence = 0.0
        """How long the pair was silent before the master's frame."""
        self._version = 0
        self._sending_until = float("-inf")
        self._busy_until = float("-inf")
        self._heard_at = float("-inf")
        self._busy_since = float("-inf")
        """Since when there was no silence that the master could have used."""
        self._babbled_at = float("-inf")
        """When there was a byte last that nobody sent."""
        self._babbles_since = float("-inf")
        """Since when there were such, with no gap between them that a stop would have waited for."""
        self._found_silence = False
        """The master's last frame did."""
        self._over_noise = False
        """The master's last frame did not wait for silence any longer."""
        self._talk: _Talk | None = None
        self._hanging: dict[SimDevice, float] = {}
        self._answering: dict[SimDevice, float] = {}

    @property
    def next_at(self) -> float:
        """When the next thing happens on the pair."""
        return self._events[0][0] if self._events else float("inf")

    def transmit(self, data: bytes, now: float) -> None:
        """The master sends."""
        start = max(now, self._sending_until)
        talk = self._talk if self._talk is not None and self._talk.until > start else None
        within = self.line.t35 if self.lenient else self.line.t15
        if not self._frame or start - self._sending_until > within + _EPSILON:
            self._frame = bytearray()
            self.frames += 1
            shortest = self.line.t35 - _EPSILON
            self._spoilt = False
            self._silence = start - self._busy_until
            is_quiet = start - max(self._heard_at, self._sending_until) >= shortest
            # What is said again over noise that goes on waits no second time.
            noisy_since = self._busy_since if self._over_noise else max(self._busy_since, self._sending_until)
            if self._found_silence and self._babbled_at == self._heard_at:
                noisy_since = min(noisy_since, self._babbles_since)  # nor does what follows one in a gap of the noise
            waited = start - noisy_since + self.line.character  # of what was heard first
            self._found_silence = is_quiet
            self._over_noise = not is_quiet and waited >= _STOP_WAITS
            self.frames_over_noise += self._over_noise
            self.early_frames += not (is_quiet or self._over_noise)
            if self._over_noise:
                self._busy_since = min(self._busy_since, noisy_since)  # for what is said next, too
        if talk is not None:
            talk.destroyed = self._spoilt = True
            self.collisions += 1
        self._frame += data
        end = start + self.line.airtime(len(data))
        self._sending_until = end
        self._busy_until = max(self._busy_until, end)
        self._version += 1
        version = self._version
        self._at(end + self.line.t35, lambda now: self._complete(version, end, now))
        if self.noise.echo:
            self._arrive(bytes(data), start, None)
        elif self.ears:
            self._pass_on(bytes(data), start, self._overhear)

    def speak(self, line: LineSettings) -> None:
        """The master speaks and listens like this from now on."""
        self.line = line
        self.usable_silence = line.t35

    def babble(self, intervals: Iterator[float], now: float) -> None:
        """From now on there are bytes that nobody sends, one after each of those intervals: a pair without bias, say.

        While somebody sends there are none. A frame that follows such a byte, or is followed by one, before t3.5 of
        silence is not understood, unless the pair is `lenient`.
        """

        def byte(now: float) -> None:
            if self._sending_until <= now and (self._talk is None or self._talk.until <= now):
                self._busy_until = now
                if now - self._babbled_at > _STOP_WAITS:
                    self._babbles_since = now
                self._babbled_at = now
                self._spoilt = self._spoilt or not self.lenient
                self._hear(self._rng.randbytes(1), None, now)
            self.babble(intervals, now)

        interval = next(intervals, None)
        if interval is not None:
            self._at(now + interval, byte)

    def advance(self, now: float) -> list[bytes]:
        """Let everything happen that is due; return what the master received, in pieces."""
        while self._events and self._events[0][0] <= now:
            when, _, happen = heapq.heappop(self._events)
            happen(when)
        received, self._received = self._received, []
        return received

    def _at(self, when: float, happen: Callable[[float], None]) -> None:
        heapq.heappush(self._events, (when, next(self._number), happen))

    def _chance(self, probability: float) -> bool:
        return probability > 0 and self._rng.random() < probability

    def _complete(self, version: int, end: float, now: float) -> None:
        """The master has been silent for t3.5: its frame is whole."""
        if version != self._version:
            return
        frame, spoilt, silence = bytes(self._frame), self._spoilt, self._silence
        self._frame = bytearray()
        treatment = PLAIN if self.script is None else self.script(frame, now)
        if spoilt or not treatment.heard or self._chance(self.noise.lost_request):
            return
        if self._chance(self.noise.flipped_request):
            frame = self._flip(frame)
        for device in self.devices:
            if not device.heeds(frame):
                continue
            needed = self.line.t35 if device.silence is None else device.silence
            if silence < needed - _EPSILON and not self.lenient:
                continue
            if device.rate(now) not in (None, self.line.baudrate) or self._hanging.get(device, 0.0) > now:
                continue
            if frame[0] == device.address and self._chance(self.noise.hang):
                self._hanging[device] = now + self._rng.uniform(0, self.noise.hang_for)
                continue
            reply = self._answer(device, frame, treatment, now)
            if reply is None or self._chance(self.noise.lost_reply):
                continue
            if device.rate(now) not in (None, self.line.baudrate):
                reply = self._rng.randbytes(len(reply))  # it answers at another rate already
            turnaround = self.turnaround if device.turnaround is None else device.turnaround
            delay = treatment.delay
            delay += self._rng.uniform(0, self.noise.late_by) if self._chance(self.noise.late) else 0.0
            # A device that is late answers what it is asked meanwhile after that: in order.
            start = max(end + turnaround + delay, now, self._answering.get(device, 0.0) + self.line.t35)
            self._answering[device] = start + self.line.airtime(len(reply))
            self._at(start, lambda now, reply=reply: self._reply(reply, now))  # type: ignore[misc]

    def _answer(self, device: SimDevice, frame: bytes, treatment: Treatment, now: float) -> bytes | None:
        """Have a device hear a frame; return what of its reply reaches the master."""
        if treatment is PLAIN or frame[0] not in (device.address, BROADCAST):
            return device.receive(frame, now)
        if treatment.before is not None:
            treatment.before(device, now)
        reply = device.receive(frame, now) if treatment.carried_out else None
        if treatment.code is not None and frame[0] != BROADCAST:
            body = bytes((frame[0], frame[1] | 0x80, treatment.code))
            reply = body + crc(body)
        if treatment.after is not None:
            treatment.after(device, now)
        return treatment.of_reply(reply) if reply and treatment.answered else None

    def _reply(self, reply: bytes, now: float) -> None:
        if self._chance(self.noise.flipped):
            reply = self._flip(reply)
        if self._chance(self.noise.torn):
            reply = reply[: self._rng.randrange(len(reply))]
        if self._chance(self.noise.duplicated):
            reply += reply
        if self._chance(self.noise.foreign):
            body = bytes((self._rng.randrange(1, 248), 3, 2)) + self._rng.randbytes(2)
            reply = body + crc(body) + reply
        if self._chance(self.noise.stray):
            reply = self._rng.randbytes(self._rng.randrange(1, 9)) + reply
        if not reply:
            return
        talk = _Talk(now + self.line.airtime(len(reply)))
        if self._sending_until > now + _EPSILON:
            self._spoilt = talk.destroyed = True
            self.collisions += 1
        if self._talk is not None and self._talk.until > now + _EPSILON:
            self._talk.destroyed = talk.destroyed = True
            talk.until = max(talk.until, self._talk.until)
            self.collisions += 1
        self._talk = talk
        self._busy_until = max(self._busy_until, talk.until)
        self._arrive(reply, now, talk)

    def _arrive(self, data: bytes, start: float, talk: _Talk | None) -> None:
        """Bytes reach the master as they are sent."""
        self._pass_on(data, start, lambda piece, now: self._hear(piece, talk, now))

    def _pass_on(self, data: bytes, start: float, hear: Callable[[bytes, float], None]) -> None:
        """Have bytes heard as they are sent, a few at a time."""
        size = max(1, int(_PIECE / self.line.character))
        for at in range(0, len(data), size):
            piece = data[at : at + size]
            self._at(start + self.line.airtime(at + len(piece)), lambda now, piece=piece: hear(piece, now))  # type: ignore[misc]

    def _hear(self, piece: bytes, talk: _Talk | None, now: float) -> None:
        # While it sends over noise it does not hear whether that goes on.
        quiet_since = max(self._heard_at, self._sending_until) if self._over_noise else self._heard_at
        if now - quiet_since > self.usable_silence + len(piece) * self.line.character:
            self._busy_since = now
        self._heard_at = now
        destroyed = talk is not None and talk.destroyed
        heard = self._rng.randbytes(len(piece)) if destroyed else piece
        self._received.append(heard)
        self._overhear(heard, now)

    def _overhear(self, piece: bytes, now: float) -> None:
        for ear in self.ears:
            ear(piece, now)

    def _flip(self, frame: bytes) -> bytes:
        bits = int.from_bytes(frame, "big")
        for _ in range(self._rng.randrange(1, 4)):
            bits ^= 1 << self._rng.randrange(8 * len(frame))
        return bits.to_bytes(len(frame), "big")
