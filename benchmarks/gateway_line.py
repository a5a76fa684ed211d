"""Gateways on the loopback, paced like the pairs behind them, in a process of their own that spins.

    python -m benchmarks.gateway_line '{"count": 16, "mbap": false, "baudrate": 38400}'

Each answers reads, one after the other: it hands a reply over when the airtime of request and reply, the turnaround and
t3.5 are over. Prints the TCP ports; it ends on SIGTERM, and with who started it.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import select
import signal
import socket
import sys
import time
from dataclasses import dataclass, field

from benchmarks.orphans import end_with_parent
from benchmarks.setting import READ_COUNT, Setting
from rs485bus.wire.crc import crc

_READ = 8 + 5 + 2 * READ_COUNT
"""Bytes of a read and its answer."""


def limit(setting: Setting) -> float:
    """Reads a second that a pair allows."""
    return 1 / (setting.line.airtime(_READ) + setting.turnaround + setting.line.t35)


@dataclass(slots=True)
class _Gateway:
    """One listening gateway, with one client at a time."""

    listener: socket.socket
    client: socket.socket | None = None
    received: bytes = b""
    free_at: float = 0.0
    replies: list[tuple[float, bytes]] = field(default_factory=list)


class Gateways:
    """Some gateways in one process.

    Args:
        count: how many.
        mbap: they speak Modbus TCP, otherwise RTU over TCP.
        setting: how the pairs behind them are set.
    """

    def __init__(self, count: int, mbap: bool, setting: Setting) -> None:
        self._mbap = mbap
        self._takes = 1 / limit(setting)
        self._gateways = [_Gateway(socket.create_server(("127.0.0.1", 0))) for _ in range(count)]
        self._poller = select.poll()
        self._of: dict[int, _Gateway] = {}
        for gateway in self._gateways:
            gateway.listener.setblocking(False)
            self._of[gateway.listener.fileno()] = gateway
            self._poller.register(gateway.listener, select.POLLIN)
        self.stopped = False

    @property
    def ports(self) -> list[int]:
        return [gateway.listener.getsockname()[1] for gateway in self._gateways]

    def run(self) -> None:
        """Serve until `stopped` is set."""
        while not self.stopped:
            for fd, _ in self._poller.poll(0):
                self._readable(fd)
            now = time.monotonic()
            for gateway in self._gateways:
                while gateway.replies and gateway.replies[0][0] <= now:
                    if gateway.client is not None:
                        with contextlib.suppress(OSError):
                            gateway.client.send(gateway.replies[0][1])
                    del gateway.replies[0]

    def _readable(self, fd: int) -> None:
        gateway = self._of[fd]
        if fd == gateway.listener.fileno():
            client, _ = gateway.listener.accept()
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            gateway.client, gateway.received = client, b""
            self._of[client.fileno()] = gateway
            self._poller.register(client, select.POLLIN)
            return
        assert gateway.client is not None
        try:
            data = gateway.client.recv(4096)
        except ConnectionResetError:
            data = b""
        if not data:
            self._poller.unregister(fd)
            del self._of[fd]
            gateway.client.close()
            gateway.client = None
            return
        gateway.received += data
        length = 12 if self._mbap else 8  # of a read
        while len(gateway.received) >= length:
            frame, gateway.received = gateway.received[:length], gateway.received[length:]
            gateway.free_at = max(gateway.free_at, time.monotonic()) + self._takes
            gateway.replies.append((gateway.free_at, self._reply(frame)))

    def _reply(self, frame: bytes) -> bytes:
        unit, function, count = (frame[6], frame[7], frame[11]) if self._mbap else (frame[0], frame[1], frame[5])
        body = bytes((unit, function, 2 * count)) + b"\0\1" * count
        return frame[:4] + len(body).to_bytes(2, "big") + body if self._mbap else body + crc(body)


def main() -> None:
    end_with_parent()
    options = json.loads(sys.argv[1])
    if options["core"] is not None:
        os.sched_setaffinity(0, {options["core"]})
    gateways = Gateways(options["count"], options["mbap"], Setting(baudrate=options["baudrate"]))

    def stop(*_: object) -> None:
        gateways.stopped = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    print(json.dumps(gateways.ports), flush=True)
    gc.disable()
    gateways.run()


if __name__ == "__main__":
    main()
