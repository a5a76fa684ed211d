"""How long it takes from an event to the error that tells of it, and until the motor is stopped.

python -m benchmarks.latency                    everything; some minutes
python -m benchmarks.latency --families MKS     one family
python -m benchmarks.latency --groups           groups only

Virtual drives on a virtual clock. Something happens 1 s into a motion: a fault, a stall, a limit, a motor that somebody
lets go of, a restart. The application does nothing meanwhile, or asks status and position 5, 20 or 50 times a second.
The line is clean, loses 5 % of the frames, or is saturated by others that read without a pause. Latencies are those of
the error: raised to who waits, or told as an event where nobody waits; and of the last motor to stand, or to push no
more. After a restart they count from when the drive answers again.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from benchmarks.virtual_clock import now, on_virtual_clock
from rs485bus import AxisGroup, Bus, BusConfig, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.bus.unit import Unit
from rs485bus.devices.mks.values import Model, Status
from rs485bus.devices.tlr.frames import auxiliary
from rs485bus.devices.tlr.homing import Homing
from rs485bus.devices.tlr.values import Auxiliary, HomingMode
from rs485bus.devices.zlac import Fault, Side
from rs485bus.devices.zlac import frames as zlac
from rs485bus.devices.zlac.values import ControlWord, Inputs
from rs485bus.errors import BusError
from rs485bus.motion.events import EventKind
from rs485bus.sim import Noise, SimMks, SimTlr, SimZlac, TlrMachine, VirtualLine
from rs485bus.sim.mks_machine import Machine
from rs485bus.wire.frames import WRITE_SINGLE

POLLS = (0, 5, 20, 50)
"""How often the application asks, in Hz."""
LINES = ("clean", "5 % lost", "saturated")
LIMIT = {"clean": 0.5, "5 % lost": 0.5, "saturated": 1.0}
"""Seconds that nothing may take."""
FOREIGN = ("by a unit", "unseen")
"""Motions that somebody else began: through this bus, or beside it on the pair."""
_HEAVY = 9999
"""mA that no motor has."""
_AT = 1.0
_PATIENCE = 5.0
_STEP = 0.002
_RPM, _FAR = 100.0, 1000.0
_AWAY = 0.6
"""Seconds for which a drive that restarts does not answer."""
_TOLD = {EventKind.FAULT, EventKind.LIMIT, EventKind.STALL, EventKind.RESTART, EventKind.LOST, EventKind.FAILED}

Happens = Callable[[Any, float], None]


@dataclass(frozen=True, slots=True)
class Family:
    """A drive that something happens to."""

    sim: Callable[[], Any]
    facade: Callable[[Bus], Any]
    axis: Callable[[Any], Any]
    events: Mapping[str, Happens]
    turns: Callable[[Any, float], bool]
    """Whether a motor of it turns, or pushes."""
    motions: Mapping[str, Callable[[Any], Any]]
    """Each begins a motion of the axis, or of all; what it returns is awaited."""
    baudrate: int = 38400
    impossible: frozenset[tuple[str, str]] = field(default_factory=frozenset)
    """Motions to which an event does not happen, or whose drive does not tell of it."""


@dataclass(frozen=True, slots=True)
class Latency:
    """What was measured, in seconds."""

    told: float
    stopped: float


# The families


def _mks_limit(sim: SimMks, at: float) -> None:
    seeks, level, torque, _ = sim.settings[0x90]
    sim.settings[0x90] = (seeks, level, torque, True)
    here = sim.shaft(at)
    if sim.motion.motor.rpm(at) > 0:
        sim.motion.machine.right_switch = here
    else:
        sim.motion.machine.home_switch = here
    sim.advance(at)


def _mks_held(sim: SimMks, at: float) -> None:
    sim.put_load(_HEAVY, at)
    sim.motion.stalled = False


def _zlac_release(sim: SimZlac, at: float) -> None:
    sim.receive(zlac.control(1, ControlWord.RELEASE).adu, at)


def _tlr_release(sim: SimTlr, at: float) -> None:
    sim.receive(auxiliary(1, Auxiliary.NONE).adu, at)
    sim.receive(auxiliary(1, Auxiliary.RELEASE).adu, at)


def _tlr_block(sim: SimTlr, at: float) -> None:
    here, rpm = sim.shaft(at), sim.motion.motor.rpm(at)
    low, high = sim.motion.machine.travel
    sim.motion.machine.travel = (here if rpm < 0 else low, here if rpm > 0 else high)
    sim.motion.advance(at)


def _tlr_restart(sim: SimTlr, at: float) -> None:
    sim.power_cycle(at, dropped=_AWAY - 0.5)


def _zlac_sim() -> SimZlac:
    sim = SimZlac(1)
    sim.restart_takes = _AWAY
    return sim


async def _foreign(facade: Any, sim: Any, unit: Unit | None) -> None:
    """It is set in motion by plain requests to a unit of this bus; or, where that is None, by another master on the
    pair, and the application asks twice how it is."""
    axis = facade.left if isinstance(facade, Zlac8015d) else facade
    if isinstance(facade, Zlac8015d):
        await facade.run(10, 10)
        await facade.stop()
    for frame in axis._drive.setpoint(0, _RPM, 1000.0, afresh=True):
        if unit is None:
            sim.receive(frame.adu, now())
        elif frame.function == WRITE_SINGLE:
            await unit.write_register(frame.register, int.from_bytes(frame.adu[4:6], "big"))
        else:
            data = frame.adu[7:-2]
            await unit.write_registers(
                frame.register, [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]
            )
    for _ in range(2 if unit is None else 0):
        await asyncio.sleep(0.1)
        await facade.status()
        await axis.position()


FAMILIES = {
    "MKS": Family(
        sim=lambda: SimMks(1, model=Model.SERVO57D, machine=Machine(home_switch=-_FAR)),
        facade=lambda bus: MksServo(bus, 1, model=Model.SERVO57D, rpm=_RPM),
        axis=lambda x: x,
        events={
            "fault": lambda sim, at: sim.motion.protect(at),
            "stall": lambda sim, at: sim.put_load(_HEAVY, at),
            "held up": _mks_held,
            "limit": _mks_limit,
            "lost enable": lambda sim, at: sim._enable(False, at),
            "restart": lambda sim, at: sim.restart(at),
        },
        turns=lambda sim, at: sim.moving(at) or sim.status(at) is not Status.STOPPED,
        motions={
            "move": lambda x: x.move_to(_FAR),
            "run": lambda x: x.run(_RPM),
            "homing": lambda x: x.home(),
        },
        # It looks for a switch or a stop; and it tells of no limit that the facade has not switched on.
        impossible=frozenset({("homing", "limit"), ("homing", "stall"), ("homing", "held up"), ("unseen", "limit")}),
    ),
    "TL-R": Family(
        sim=lambda: SimTlr(1, machine=TlrMachine(origin=(-_FAR - 1, -_FAR))),
        facade=lambda bus: TlrStepper(bus, 1, rpm=_RPM),
        axis=lambda x: x,
        events={
            "fault": lambda sim, at: sim.fail(1, at),
            "stall": _tlr_block,
            "limit": lambda sim, at: sim.close(1 if sim.rpm(at) > 0 else 2, True, at),
            "lost enable": _tlr_release,
            "restart": _tlr_restart,
        },
        turns=lambda sim, at: sim.moving(at),
        motions={
            "move": lambda x: x.move_to(_FAR),
            "run": lambda x: x.run(_RPM),
            "homing": lambda x: x.home(Homing(mode=HomingMode.NEGATIVE_ORIGIN, rpm=100)),
        },
        baudrate=115200,
        # Whether it holds is not to be read: a motion of which this bus knows nothing has ended, then.
        impossible=frozenset({("homing", "limit"), ("unseen", "lost enable")}),
    ),
    "ZLAC": Family(
        sim=_zlac_sim,
        facade=lambda bus: Zlac8015d(bus, 1, rpm=_RPM),
        axis=lambda base: base.left,
        events={
            "fault": lambda sim, at: sim.fail(Side.LEFT, Fault.OVER_CURRENT, at),
            "other fault": lambda sim, at: sim.fail(Side.RIGHT, Fault.OVER_LOAD, at),
            "limit": lambda sim, at: sim.press(Inputs.X0, at),
            "lost enable": _zlac_release,
            "restart": lambda sim, at: sim.power_cycle(at),
        },
        turns=lambda sim, at: any(sim.rpm(at)),
        motions={
            "move": lambda base: base.move_to(_FAR, _FAR),
            "run": lambda base: base.run(_RPM, _RPM),
            "torque": lambda base: base.torque(2000, 2000, slope=4000),
        },
        baudrate=115200,
    ),
}
"""By name."""


# One case


async def _poll(facade: Any, axis: Any, rate: float) -> None:
    while True:
        await asyncio.sleep(1 / rate)
        with suppress(BusError):
            await facade.status()
            await axis.position()


async def _saturate(bus: Bus, address: int) -> None:
    while True:
        with suppress(BusError):
            await bus.unit(address).read_input_registers(0x31, 3)


async def latency(family: Family, motion: str, event: str, poll: float, line: str, seed: int = 0) -> Latency:
    """Something happens to a motion."""
    sim, others = family.sim(), [SimMks(address) for address in (7, 8, 9)]
    noise = Noise(lost_request=0.025, lost_reply=0.025) if line == "5 % lost" else Noise()
    baudrate = family.baudrate
    wire = VirtualLine(sim, *others, baudrate=baudrate, noise=noise, seed=seed)
    result: Latency | None = None
    with suppress(BusError):
        async with open_bus(wire, baudrate=baudrate, config=BusConfig(echo=False)) as bus:
            facade = family.facade(bus)
            axis = family.axis(facade)
            await axis.enable()
            waiting = None
            if motion in FOREIGN:
                await _foreign(facade, sim, bus.unit(1) if motion == "by a unit" else None)
            elif motion in ("move", "homing"):
                waiting = asyncio.ensure_future(family.motions[motion](facade).wait())
            else:
                await family.motions[motion](facade)
            tasks = [asyncio.ensure_future(_saturate(bus, other.address)) for other in others if line == "saturated"]
            if poll:
                tasks.append(asyncio.ensure_future(_poll(facade, axis, poll)))
            told = asyncio.Event()
            tasks.append(asyncio.ensure_future(_listen(axis, told)))
            await asyncio.sleep(_AT + 0.0137 * seed)
            assert family.turns(sim, now()), (motion, event)
            happened = now()
            family.events[event](sim, happened)
            result = await _measure(family, sim, waiting, told, happened + (_AWAY if event == "restart" else 0.0))
            for task in tasks:
                task.cancel()
            if waiting is not None and not waiting.done():
                waiting.cancel()
            axis.stop()
            raise BusError  # the block need not wait for what has failed
    assert result is not None
    return result


async def _listen(axis: Any, told: asyncio.Event) -> None:
    async for event in axis.events():
        if event.kind in _TOLD:
            told.set()


async def _measure(
    family: Family, sim: Any, waiting: asyncio.Future[Any] | None, told: asyncio.Event, since: float
) -> Latency:
    told_at = stopped_at = None
    until = since + _PATIENCE
    while now() < until and (told_at is None or stopped_at is None):
        if stopped_at is None and not family.turns(sim, now()):
            stopped_at = now()
        if told_at is None:
            if waiting is None and told.is_set():
                told_at = now()
            elif waiting is not None and waiting.done():
                assert waiting.exception() is not None, "it said that it was done"
                told_at = now()
        await asyncio.sleep(_STEP)
    return Latency(*(max(0.0, (until if at is None else at) - since) for at in (told_at, stopped_at)))


# Groups


async def group(baudrate: int, event: str, seed: int = 0) -> float:
    """Seconds from a fault of one of twelve MKS drives to all others standing, beside their ramps."""
    sims = [SimMks(address, model=Model.SERVO57D, machine=Machine(home_switch=None)) for address in range(1, 13)]
    wire = VirtualLine(*sims, baudrate=baudrate, seed=seed)
    after = _PATIENCE
    with suppress(BusError):
        async with open_bus(wire, baudrate=baudrate, config=BusConfig(echo=False)) as bus:
            axes = {f"a{sim.address}": MksServo(bus, sim.address, acceleration=20_000.0) for sim in sims}
            together = AxisGroup(**axes)
            await together.enable()
            move = together.move_to(rpm=300, **dict.fromkeys(axes, 500.0))
            await asyncio.sleep(8.0 + 0.0137 * seed)
            assert all(sim.moving(now()) for sim in sims)
            begun, who = now(), sims[3 + seed % 8]
            FAMILIES["MKS"].events[event](who, begun)
            others = [sim for sim in sims if sim is not who]
            while now() < begun + _PATIENCE and any(sim.moving(now()) for sim in others):  # noqa: ASYNC110 - none tells
                await asyncio.sleep(_STEP)
            after = now() - begun - 300 / 20_000
            with suppress(BusError):
                await move
    return after


# The report


def cases(families: Iterable[str]) -> Iterator[tuple[str, str, str]]:
    """Family, motion and event of all that can be."""
    for name in families:
        family = FAMILIES[name]
        for motion in (*family.motions, *FOREIGN):
            for event in family.events:
                if (motion, event) not in family.impossible:
                    yield name, motion, event


def table(families: Iterable[str], lines: Iterable[str], seeds: int) -> Iterator[str]:
    """The lines of the report: over all rates at which the application asks."""
    columns = f"{'told: median':>13} {'worst':>6} {'stopped: median':>16} {'worst':>6}"
    yield f"{'family':6} {'motion':9} {'event':12} {'line':10} {columns}"
    for name, motion, event in cases(families):
        for line in lines:
            runs = [
                on_virtual_clock(latency(FAMILIES[name], motion, event, poll, line, seed))
                for poll in POLLS
                for seed in range(seeds)
            ]
            told, stopped = [run.told for run in runs], [run.stopped for run in runs]
            beyond = max(*told, *stopped) > LIMIT[line]
            yield (
                f"{name:6} {motion:9} {event:12} {line:10} {statistics.median(told):13.3f} {max(told):6.3f} "
                f"{statistics.median(stopped):16.3f} {max(stopped):6.3f}{'  beyond' if beyond else ''}"
            )


def groups(seeds: int) -> Iterator[str]:
    """The lines on groups."""
    for baudrate, most in ((115200, 0.6), (9600, 1.5)):
        for event in ("fault", "stall", "held up", "lost enable"):
            took = [on_virtual_clock(group(baudrate, event, seed)) for seed in range(seeds)]
            beyond = "  beyond" if max(took) > most else ""
            yield f"12 MKS at {baudrate:6}, {event:12}: {statistics.median(took):.3f}, worst {max(took):.3f} s{beyond}"


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    parser = argparse.ArgumentParser(description="From an event to the error, and to the motor that stands.")
    parser.add_argument("--families", nargs="+", choices=list(FAMILIES), default=list(FAMILIES))
    parser.add_argument("--lines", nargs="+", choices=LINES, default=LINES)
    parser.add_argument("--seeds", type=int, default=3, help="runs of each case")
    parser.add_argument("--groups", action="store_true", help="groups only")
    given = parser.parse_args()
    if not given.groups:
        for text in table(given.families, given.lines, given.seeds):
            print(text, flush=True)
    for text in groups(given.seeds):
        print(text, flush=True)
