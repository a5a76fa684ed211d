"""What is called while no event loop runs, as between two cells of plain IPython, is refused, and nothing is begun."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from rs485bus import AxisGroup, Bus, DifferentialDrive, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.errors import BusClosed, LoopNotRunning, WrongThread
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualClockLoop, VirtualLine

VERBS: dict[str, Callable[[Any], object]] = {
    "emergency stop of the bus": lambda all_: all_.bus.emergency_stop(),
    "clear_emergency_stop": lambda all_: all_.bus.clear_emergency_stop(),
    "watchdog": lambda all_: all_.bus.watchdog(all_.x, timeout=1.0),
    "renew": lambda all_: all_.guard.renew(),
    "enable": lambda all_: all_.x.enable(),
    "disable": lambda all_: all_.x.disable(),
    "move_to": lambda all_: all_.x.move_to(1.0),
    "move_by": lambda all_: all_.x.move_by(1.0),
    "run": lambda all_: all_.x.run(60),
    "home": lambda all_: all_.x.home(),
    "set_zero": lambda all_: all_.x.set_zero(),
    "stop": lambda all_: all_.x.stop(),
    "emergency_stop": lambda all_: all_.x.emergency_stop(),
    "cancel": lambda all_: all_.move.cancel(),
    "cancel of a group": lambda all_: all_.group_move.cancel(),
    "a setting": lambda all_: all_.x.set_heartbeat(1.0),
    "a move of a group": lambda all_: all_.group.move_to(x=1.0, y=1.0),
    "enable of a group": lambda all_: all_.group.enable(),
    "stop of a group": lambda all_: all_.group.stop(),
    "home of a group": lambda all_: all_.group.home(),
    "both wheels": lambda all_: all_.base.run(60, 60),
    "one wheel": lambda all_: all_.base.left.run(60),
    "stop of both wheels": lambda all_: all_.base.stop(),
    "torque": lambda all_: all_.base.torque(100, 100),
    "a vehicle": lambda all_: all_.vehicle.drive(0.1, 0.0),
    "a TL-R": lambda all_: all_.y.run(60),
    "a new facade": lambda all_: MksServo(all_.bus, 9),
}


class Plant:
    """Drives of all families, on a loop that stands still unless something is run on it."""

    def __init__(self, runner: asyncio.Runner) -> None:
        self.runner = runner
        self.sims = SimMks(1), SimTlr(2), SimZlac(3)
        self.line = VirtualLine(*self.sims)
        runner.run(self._open())

    async def _open(self) -> None:
        self.bus: Bus = await open_bus(self.line)
        self.x, self.y, self.base = MksServo(self.bus, 1), TlrStepper(self.bus, 2), Zlac8015d(self.bus, 3)
        self.vehicle = DifferentialDrive(self.base, wheel_radius=0.085, track=0.4)
        self.group = AxisGroup(x=self.x, y=self.y)
        self.guard = self.bus.watchdog(self.x, timeout=1.0, lease=2.0)
        await asyncio.gather(self.x.enable(), self.y.enable(), self.base.enable())
        self.group_move, self.move = self.group.move_to(x=0.0, y=0.0), self.x.move_to(0.0)

    def moving(self) -> bool:
        now = self.runner.get_loop().time()
        mks, tlr, zlac = self.sims
        return mks.moving(now) or tlr.moving(now) or any(zlac.rpm(now))


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_called_while_no_event_loop_runs_is_refused_and_nothing_comes_of_it(verb: str) -> None:
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        made = Plant(runner)
        state = made.move.state
        with pytest.raises(LoopNotRunning, match=r"nothing was done\..* await bus\.emergency_stop\(\)") as refused:
            VERBS[verb](made)
        assert isinstance(refused.value, WrongThread)
        assert (made.move.state, made.bus.latched) == (state, False)
        runner.run(asyncio.sleep(1.0))  # the next, unrelated await
        assert not made.moving()
        assert made.move.done()
        assert made.move.error is None
        runner.run(made.bus.aclose())


def test_a_verb_called_in_another_event_loop_of_the_same_thread_is_refused() -> None:
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        made = Plant(runner)

        async def elsewhere() -> None:
            with pytest.raises(LoopNotRunning):
                made.x.run(60)

        asyncio.run(elsewhere())
        runner.run(made.bus.aclose())
    with pytest.raises(BusClosed):
        made.x.stop()


def test_callbacks_of_the_running_loop_and_signal_handlers_may_stop_everything() -> None:
    import signal

    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        made = Plant(runner)

        async def main() -> None:
            loop = asyncio.get_running_loop()
            await made.x.run(600)
            loop.call_soon(made.x.stop)
            await asyncio.sleep(1.0)
            assert not made.moving()
            await made.x.run(600)
            former = signal.signal(signal.SIGUSR1, lambda *_: made.bus.emergency_stop())
            signal.raise_signal(signal.SIGUSR1)
            signal.signal(signal.SIGUSR1, former)
            await asyncio.sleep(1.0)
            assert made.bus.latched
            assert not made.moving()

        runner.run(main())
        runner.run(made.bus.aclose())
