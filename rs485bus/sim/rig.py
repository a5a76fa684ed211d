"""An owner on a virtual pair, driven by plain calls: no event loop, time is a number."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable

from rs485bus.bus.config import BusConfig
from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job
from rs485bus.sim.device import SimDevice
from rs485bus.sim.line import VirtualPair
from rs485bus.sim.noise import Noise
from rs485bus.wire.frames import Request
from rs485bus.wire.timing import LineSettings

FAST = LineSettings(baudrate=115200)
QUIET = Noise()
NO_ECHO = BusConfig(echo=False)


class Rig:
    """Owner and pair on one clock. The frames sent are kept as (time, bytes).

    Args:
        devices: what hangs on the pair.
        line: how characters travel.
        noise: what goes wrong, reproducible from `seed`.
        config: how the owner behaves.
        turnaround: seconds the devices take before they answer.
        gateway: as for `Owner`.
        keep_frames: whether to keep them.
        on_send: told of each frame, and when it begins.
    """

    def __init__(
        self,
        *devices: SimDevice,
        line: LineSettings = FAST,
        noise: Noise = QUIET,
        seed: int = 0,
        config: BusConfig = NO_ECHO,
        turnaround: float = 0.002,
        gateway: bool = False,
        keep_frames: bool = True,
        on_send: Callable[[bytes, float], None] | None = None,
    ) -> None:
        self.now = 100.0
        self.pair = VirtualPair(devices, line, noise, seed, turnaround)
        if gateway:
            self.pair.usable_silence = config.silence_on(line, gateway)
        # The line has been quiet for a while, so that what is submitted first goes out at once.
        self.owner = Owner(line, config, self.now - 1, gateway=gateway)
        self.sent: list[tuple[float, bytes]] = []
        self._keep = keep_frames
        self._on_send = on_send
        self._connected = True
        self._calls: list[tuple[float, int, Callable[[], None]]] = []
        self._number = itertools.count()

    def at(self, when: float, call: Callable[[], None]) -> None:
        """Do something at a time."""
        heapq.heappush(self._calls, (when, next(self._number), call))

    def submit(self, request: Request, **options: object) -> Job:
        job = Job(request, **options)  # type: ignore[arg-type]
        self.owner.submit(job, self.now)
        return job

    def run(self, seconds: float | None = None, until: Callable[[], bool] = lambda: False) -> None:
        """Let time pass, until nothing more happens, for so long, or until something holds."""
        end = float("inf") if seconds is None else self.now + seconds
        self._tick()
        while not until():
            following = min(self.owner.wake, self.pair.next_at, self._calls[0][0] if self._calls else float("inf"))
            if following > end or following == float("inf"):
                break
            self.now = max(self.now, following)
            self.step()
        if seconds is not None and not until():
            self.now = end

    def step(self) -> None:
        """Whatever is due now."""
        while self._calls and self._calls[0][0] <= self.now:
            heapq.heappop(self._calls)[2]()
        for piece in self.pair.advance(self.now):
            if self._connected:
                self.owner.feed(piece, self.now)
        self._tick()

    def unplug(self) -> None:
        """The port is lost."""
        self._connected = False
        self.owner.unplugged(self.now)

    def plug(self) -> None:
        """The port is there again."""
        self._connected = True
        self.owner.plugged(self.now)

    def done(self, *jobs: Job, within: float = 60.0) -> None:
        """Let time pass until the jobs have ended."""
        self.run(within, lambda: all(job.outcome is not None for job in jobs))
        assert all(job.outcome is not None for job in jobs)

    def _tick(self) -> None:
        frame = self.owner.tick(self.now)
        if frame is not None:
            if self._keep:
                self.sent.append((self.now, frame))
            if self._on_send is not None:
                self._on_send(frame, self.owner.send_at)
            self.pair.transmit(frame, self.owner.send_at)
