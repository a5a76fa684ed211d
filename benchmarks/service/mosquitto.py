"""A mosquitto of one's own, on a free port of the loopback."""

from __future__ import annotations

import contextlib
import getpass
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path


def executable() -> str:
    """Where mosquitto is. Debian has it in /usr/sbin, which not every user's path names."""
    found = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")
    assert found is not None, "the tests of the service need mosquitto: apt-get install mosquitto"
    return found


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Mosquitto:
    """One broker, which can be killed and started again at the same port.

    Args:
        folder: where its configuration goes.
        lines: what stands in the configuration besides the listener.
        anonymous: let in who names no user.
        host: the address at which it listens.
        inside: what stands before its command, so that it runs in a network of its own, say.
    """

    def __init__(
        self,
        folder: Path,
        lines: str = "",
        *,
        anonymous: bool = True,
        host: str = "127.0.0.1",
        inside: tuple[str, ...] = (),
    ) -> None:
        self.port = free_port()
        self._process: subprocess.Popen[bytes] | None = None
        self._host = host
        self._inside = inside
        self._file = folder / f"mosquitto-{self.port}.conf"
        allowed = "true" if anonymous else "false"
        # Started by root it would become another user, who cannot read what tests write.
        lines = f"user {getpass.getuser()}\n{lines}"
        self._file.write_text(
            f"listener {self.port} {host}\nallow_anonymous {allowed}\nset_tcp_nodelay true\n{lines}\n"
        )
        self._log = folder / f"mosquitto-{self.port}.log"

    @property
    def url(self) -> str:
        return f"mqtt://{self._host}:{self.port}"

    def start(self) -> None:
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                (*self._inside, executable(), "-c", str(self._file)), stdout=log, stderr=log
            )
        deadline = time.monotonic() + 10
        while True:
            with contextlib.suppress(OSError), socket.create_connection((self._host, self.port), 1):
                return
            assert self._process.poll() is None, self._log.read_text()
            assert time.monotonic() < deadline, "mosquitto does not listen"
            time.sleep(0.02)

    def kill(self) -> None:
        """Like kill -9."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()
        self._process = None

    def stop(self) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.wait(5)
            self._process = None

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid


@contextlib.contextmanager
def running(folder: Path, lines: str = "", *, anonymous: bool = True) -> Iterator[Mosquitto]:
    """A mosquitto for the length of a block."""
    broker = Mosquitto(folder, lines, anonymous=anonymous)
    broker.start()
    try:
        yield broker
    finally:
        broker.stop()
