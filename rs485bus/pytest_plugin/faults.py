"""Faults of a virtual line, when a test asks for them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from rs485bus.sim import SimDevice, VirtualLine
from rs485bus.wire.frames import crc

_Answer = Callable[[bytes, float], bytes | None]
_Fate = Callable[[_Answer, bytes, float], bytes | None]


class LineFaults:
    """What goes wrong from now on, frame by frame. Made by the fixture `line_faults`.

    A fault concerns the next frames to one address, as many as `count` says, from the moment when the test asks for it.
    """

    def __init__(self, line: VirtualLine) -> None:
        self._line = line
        self._fates: dict[SimDevice, deque[_Fate]] = {}

    def lose_requests(self, address: int, count: int = 1) -> None:
        """The device never sees the next requests."""
        self._change(address, count, lambda answer, frame, now: None)

    def lose_replies(self, address: int, count: int = 1) -> None:
        """The device does what the next requests say, and its replies are lost."""
        self._change(address, count, lambda answer, frame, now: _ignored(answer(frame, now)))

    def damage_replies(self, address: int, count: int = 1) -> None:
        """A bit of each of the next replies arrives inverted."""
        self._change(address, count, lambda answer, frame, now: _damaged(answer(frame, now)))

    def refuse(self, address: int, code: int, count: int = 1) -> None:
        """The device answers the next requests with an exception, and does nothing."""
        self._change(address, count, lambda answer, frame, now: _exception(frame, code))

    def silence(self, address: int) -> Callable[[], None]:
        """The device hears nothing any more. Returns a function that ends that."""
        device = self._device(address)
        heeds = device.heeds
        device.heeds = lambda frame: False  # type: ignore[method-assign] # this is the fault

        def wake() -> None:
            device.heeds = heeds  # type: ignore[method-assign] # and this its end

        return wake

    def unplug(self) -> None:
        """The adapter is pulled out of the computer."""
        self._line.unplug()

    def plug(self) -> None:
        """It is put in again."""
        self._line.plug()

    def _device(self, address: int) -> SimDevice:
        for device in self._line.pair.devices:
            if device.address == address:
                return device
        raise ValueError(f"there is no device at address {address} on the virtual line")

    def _change(self, address: int, count: int, fate: _Fate) -> None:
        """Have the next frames to a device meet a fate, after those that were asked for before."""
        device = self._device(address)
        if device not in self._fates:
            self._fates[device] = deque()
            device.receive = self._receiver(device.receive, address, self._fates[device])  # type: ignore[assignment,method-assign] # these are the faults
        self._fates[device].extend([fate] * count)

    def _receiver(self, answer: _Answer, address: int, fates: deque[_Fate]) -> _Answer:
        def receive(frame: bytes, now: float) -> bytes | None:
            if not fates or frame[0] != address:
                return answer(frame, now)
            return fates.popleft()(answer, frame, now)

        return receive


def _ignored(reply: bytes | None) -> None:
    """What was done was done; nobody hears of it."""


def _damaged(reply: bytes | None) -> bytes | None:
    return None if reply is None else bytes([reply[0], reply[1] ^ 1, *reply[2:]])


def _exception(frame: bytes, code: int) -> bytes:
    body = bytes((frame[0], frame[1] | 0x80, code))
    return body + crc(body)
