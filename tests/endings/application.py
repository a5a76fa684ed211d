"""The bus among tasks that are cancelled, callbacks that raise and a line that fails, on a virtual clock; and a judge.

python -m tests.endings.shell --examples 2000 --seed 1
python -m tests.endings.shell --only 17
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections import Counter
from collections.abc import Awaitable, Callable
from typing import Any

from rs485bus import AxisGroup, Bus, BusConfig, LineSettings, MksServo, Move, open_bus
from rs485bus.bus.schedule.job import Urgency
from rs485bus.errors import BusError, DeviceRefused, NotSent, StopUnconfirmed
from rs485bus.wire.registers import Repeat
from tests.endings import draw
from tests.endings.cable import Cable, Sent
from tests.endings.calls import REPLY_TIMEOUT, Boom, Call, leaves
from tests.endings.port import CablePort
from tests.endings.slaves import Memory, Mks, Slave


class Application:
    """A random application, and what it was told."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = random.Random(seed)
        self.wrong: list[str] = []
        self.calls: list[Call] = []
        self.counts: Counter[str] = Counter()
        self.logged: list[str] = []
        self.token = 1000
        self.line = LineSettings(baudrate=rng.choice((115_200, 38_400)))
        silent = rng.random() < 0.7
        self.drives = {address: Mks(address, by_silence=silent) for address in (1, 2)}
        self.plain = Slave(10, silent)
        self.memory = Memory(12, by_silence=silent)
        self.slaves: dict[int, Slave] = {**self.drives, 10: self.plain, 12: self.memory}
        gateway = rng.random() < 0.15
        echo = "" if gateway or rng.random() < 0.7 else rng.choice(("full", "split", "damaged"))
        self.cable = Cable(
            self.line.character,
            self.line.t35,
            list(self.slaves.values()),
            echo=echo,
            latency=rng.choice((0.0, 0.0, 0.001, 0.016)),
            gateway=gateway,
            latest=4.8 if gateway else 0.5,
        )
        self.port = CablePort(self.cable, self.line, gateway=gateway)
        self.config = BusConfig(
            reply_timeout=REPLY_TIMEOUT,
            turnaround=0.02,
            close_timeout=2.0,
            echo="auto" if rng.random() < 0.6 else bool(echo),
        )
        self.hostility = rng.choice((0.0, 0.2, 0.5))
        self.raising = rng.random() < 0.3
        self.stop_asked: set[int] = set()
        for drive in self.drives.values():
            drive.lies = rng.random() < 0.05
        self.for_foreign = rng.random() < 0.15
        self.bus: Bus | None = None
        self.axes: dict[int, MksServo] = {}
        self.reports: list[str] = []

    # What is awaited is noted

    async def ask(self, what: str, awaitable: Awaitable[Any], timeout: float | None = None) -> Any:
        """Await something; note when it begins and ends, and how."""
        loop = asyncio.get_running_loop()
        call = Call(what, loop.time(), timeout)
        self.calls.append(call)
        try:
            result = await awaitable
        except BusError as error:
            call.how = type(error).__name__
            self.counts[call.how] += 1
            raise
        except BaseException as error:
            call.how = type(error).__name__
            raise
        else:
            call.how = "done"
            self.counts["done"] += 1
            return result
        finally:
            call.ended = loop.time()

    async def tolerate(self, what: str, awaitable: Awaitable[Any], timeout: float | None = None) -> Any:
        """Await something whose failure is no matter."""
        with contextlib.suppress(BusError, ValueError, Boom):
            return await self.ask(what, awaitable, timeout)

    # What the tasks do

    async def read(self) -> None:
        rng, loop = self.rng, asyncio.get_running_loop()
        assert self.bus is not None
        register, count, holding = rng.randrange(4), rng.randrange(1, 4), rng.random() < 0.5
        unit = self.bus.unit(rng.choice((10, 10, 10, 20)))
        timeout = round(rng.uniform(0.005, 2), 3) if rng.random() < 0.4 else None
        method = unit.read_holding_registers if holding else unit.read_input_registers
        urgency = rng.choice((Urgency.COMMAND, Urgency.POLL))
        begun = loop.time()
        words = await self.tolerate(
            f"read {unit.address}:{register}+{count}",
            method(register, count, timeout=timeout, urgency=urgency),
            timeout,
        )
        if words is not None:
            stamp = self.plain.stamps.get(words[0])
            wanted = bytes((3 if holding else 4, 0, register, 0, count))
            if unit.address != 10 or stamp is None or stamp.pdu != wanted or not begun <= stamp.at <= loop.time():
                self.fault(f"a read got the answer to another: {wanted.hex()} {words} {stamp}")

    async def write(self) -> None:
        rng, loop = self.rng, asyncio.get_running_loop()
        assert self.bus is not None
        self.token += 1
        value, register, address = self.token, rng.randrange(4), rng.choice((12, 12, 12, 10, 20))
        repeat = rng.choice((Repeat.NEVER, Repeat.NEVER, Repeat.SAFE, Repeat.VERIFY))
        if repeat is Repeat.VERIFY and address == 10:
            address = 12  # what is written must be there to be read
        timeout = round(rng.uniform(0.005, 2), 3) if rng.random() < 0.4 else None
        many = rng.random() < 0.4
        unit, begun, how = self.bus.unit(address), loop.time(), ""
        sending = (
            unit.write_registers(register, [value, value], timeout=timeout, repeat=repeat)
            if many
            else unit.write_register(register, value, timeout=timeout, repeat=repeat)
        )
        what = f"write {address}:{register}={value} {repeat.name} {'many' if many else 'one'}"
        try:
            await self.ask(what, sending, timeout)
            how = "done"
        except BusError as error:
            how = type(error).__name__
            asked = isinstance(error, (DeviceRefused, NotSent))
            self.later(lambda: self.judge_write(what, value, "not done" if asked else how, begun, repeat))
        except asyncio.CancelledError:
            at = loop.time()
            self.later(lambda: self.judge_cancelled(what, value, at))
            raise
        else:
            self.later(lambda: self.judge_write(what, value, "done", begun, repeat))

    def executions(self, value: int) -> list[tuple[float, Sent]]:
        """When a value was written, and by which frame."""
        wanted = value.to_bytes(2, "big")
        return [
            (done.at, done.sent)
            for slave in (self.plain, self.memory)
            for done in slave.done
            if done.pdu[0] in (6, 16) and not done.refused and done.pdu[-2:] == wanted
        ]

    def judge_write(self, what: str, value: int, how: str, begun: float, repeat: Repeat) -> None:
        came = self.executions(value)
        if how == "done" and not came:
            self.fault(f"{what}: said to be done, and was not")
        if how == "not done" and came:
            self.fault(f"{what}: said not to be done, and was")
        if how == "NoReply" and repeat is not Repeat.SAFE:
            self.fault(f"{what}: NoReply for what must not be repeated blindly")
        if repeat is Repeat.NEVER and len({sent for _, sent in came}) > 1:
            self.fault(f"{what}: done {len(came)} times")

    def judge_cancelled(self, what: str, value: int, at: float) -> None:
        wanted = value.to_bytes(2, "big")
        for sent in self.cable.sent:
            if sent.start > at + 1e-6 and sent.frame[1] in (6, 16) and sent.frame[-4:-2] == wanted:
                self.fault(f"{what}: cancelled at {at:.4f}, sent at {sent.start:.4f}")

    async def broadcast(self) -> None:
        assert self.bus is not None
        await self.tolerate("broadcast", self.bus.broadcast.write_register(0x20, self.rng.randrange(5)))

    async def move(self) -> None:
        rng, axis = self.rng, self.axes[self.rng.choice((1, 2))]
        kind = rng.randrange(11)
        try:
            if kind == 0:
                handle: Any = axis.enable()
            elif kind == 1:
                handle = axis.move_to(rng.uniform(-3, 3), rpm=rng.choice((120, 600)))
            elif kind == 2:
                handle = axis.move_by(rng.uniform(-2, 2), rpm=600)
            elif kind == 3:
                handle = axis.run(rng.choice((60, -300)), acceleration=2000)
            elif kind == 4:
                handle = axis.stop()
                self.stop_asked.add(axis.address)
            elif kind == 5:
                handle = axis.emergency_stop()
                self.stop_asked.add(axis.address)
            elif kind == 6:
                handle = axis.set_zero()
            elif kind == 7:
                handle = self.group.move_to(x=rng.uniform(-1, 1), y=rng.uniform(-1, 1))
            elif kind == 8:
                handle = axis.move_to(rng.uniform(-9, 9), rpm=120)
                asyncio.get_running_loop().call_later(rng.uniform(0, 0.5), handle.cancel)
            elif kind == 9:
                await self.within(axis.move_to(rng.uniform(-9, 9), rpm=120))
                return
            else:
                await self.tolerate("position", axis.position())
                return
        except (BusError, ValueError):
            return
        if self.raising and rng.random() < 0.3:
            handle.add_done_callback(self.boom)
        if rng.random() < 0.6:
            await self.tolerate(f"{handle.what} {axis.address}", handle)

    async def within(self, move: Move) -> None:
        """A block around a move, left by an exception: the axis is stopped."""
        with contextlib.suppress(BusError, Boom):
            async with move:
                await asyncio.sleep(self.rng.uniform(0, 0.3))
                if self.rng.random() < 0.5:
                    raise Boom

    async def emergency(self) -> None:
        assert self.bus is not None
        handle = self.bus.emergency_stop()
        self.stop_asked |= {1, 2}
        if self.raising and self.rng.random() < 0.3:
            handle.add_done_callback(self.boom)
        if self.rng.random() < 0.7:
            await self.tolerate("bus.emergency_stop", handle)
            with contextlib.suppress(BusError):
                self.bus.clear_emergency_stop()

    async def guard(self) -> None:
        assert self.bus is not None
        axes = [axis for axis in self.axes.values() if self.rng.random() < 0.6] or list(self.axes.values())
        lease = self.rng.choice((None, None, 0.3))
        loop = asyncio.get_running_loop()
        guard = self.bus.watchdog(*axes, timeout=self.rng.choice((0.5, 1.0)), lease=lease)
        entering = Call("entering a watchdog block", loop.time())
        self.calls.append(entering)
        leaving: Call | None = None
        try:
            async with guard:
                entering.ended = loop.time()
                for _ in range(self.rng.randrange(3)):
                    await self.move()
                    if lease:
                        guard.renew()
                leaving = Call("leaving a watchdog block", loop.time())
                self.calls.append(leaving)
                if self.rng.random() < 0.3:
                    raise Boom
        except (BusError, Boom):
            pass
        except BaseExceptionGroup as group:
            if group.split((BusError, Boom))[1] is not None:
                raise
        finally:
            entering.ended = entering.ended or loop.time()
            if leaving is not None:
                leaving.ended = loop.time()

    def boom(self, handle: object) -> None:
        self.counts["boom"] += 1
        raise Boom

    # What the world does

    def trouble(self) -> None:
        rng = self.rng
        if rng.random() >= self.hostility:
            return
        kind = rng.random()
        loop = asyncio.get_running_loop()
        if kind < 0.6:
            address, reaction = draw.reaction(rng)  # type: ignore[misc]
            self.slaves.get(address, self.memory).reactions.append(reaction)  # type: ignore[arg-type, call-overload]
        elif kind < 0.7:
            self.slaves[rng.choice((1, 2, 10, 12))].dead_until = loop.time() + rng.choice((0.1, 1.0, 20.0))
        elif kind < 0.8:
            self.babble_until = loop.time() + rng.choice((0.1, 1.0, 3.0))
            self.babble()
        elif kind < 0.87:
            self.port.vanish(stays=rng.random() < 0.5)
            loop.call_later(rng.choice((0.05, 1.0, 50.0)), self.port.back)
        else:
            self.cable.noise(draw.foreign(rng), loop.time())
            self.port.pump()

    def babble(self) -> None:
        loop = asyncio.get_running_loop()
        if loop.time() < self.babble_until:
            self.cable.noise(bytes([self.rng.randrange(256)]), loop.time())
            self.port.pump()
            loop.call_later(self.rng.uniform(0.0005, 0.0016), self.babble)

    async def worker(self) -> None:
        rng = self.rng
        for _ in range(rng.randrange(1, 8)):
            self.trouble()
            kind = rng.random()
            if kind < 0.3:
                await self.read()
            elif kind < 0.55:
                await self.write()
            elif kind < 0.85:
                await self.move()
            elif kind < 0.9:
                await self.broadcast()
            elif kind < 0.93:
                await self.emergency()
            else:
                await self.guard()
            if rng.random() < 0.5:
                await asyncio.sleep(rng.choice((0, 0.001, 0.05, 0.4)))

    async def main(self) -> None:
        rng, loop = self.rng, asyncio.get_running_loop()
        async with open_bus(self.port, config=self.config) as bus:
            self.bus = bus
            self.axes = {address: MksServo(bus, address) for address in (1, 2)}
            self.group = AxisGroup(x=self.axes[1], y=self.axes[2])
            if self.raising:
                bus.subscribe(self.boom)
            if self.for_foreign:
                for drive in self.drives.values():
                    drive._go(loop.time(), 0, 300, 1e12)
            tasks = [loop.create_task(self.worker()) for _ in range(rng.randrange(1, 5))]
            for task in tasks:
                if rng.random() < 0.4:
                    for _ in range(rng.choice((1, 1, 2, 3))):
                        loop.call_later(rng.expovariate(2), task.cancel)
            for ended in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(ended, Exception):
                    self.fault(f"a task got {ended!r}")
            kind = rng.random()
            self.leaving = Call("leaving the bus", loop.time())
            self.calls.append(self.leaving)
            if kind < 0.35:
                if rng.random() < 0.5 and not bus.latched:
                    with contextlib.suppress(BusError, ValueError):
                        self.axes[1].run(200)
                raise Boom
            if kind < 0.45:
                bus.emergency_stop()
                self.stop_asked |= {1, 2}
                raise Boom
            if kind < 0.5:
                self.axes[2].stop()
                self.stop_asked.add(2)
                raise Boom

    async def whole(self) -> None:
        """The program, interrupted now and then."""
        rng, loop = self.rng, asyncio.get_running_loop()
        program = loop.create_task(self.main())
        if rng.random() < 0.3:
            for _ in range(rng.randrange(1, 4)):
                loop.call_later(rng.expovariate(1), program.cancel)
        errors: list[BaseException] = []
        try:
            await program
        except BaseException as error:
            errors = list(leaves(error))
        if hasattr(self, "leaving"):
            self.leaving.ended = loop.time()
        self.left(loop.time(), errors)
        await asyncio.sleep(8)
        for judge in self._later:
            judge()
        if self.port.after_close:
            self.fault(f"{len(self.port.after_close)} frames after the port was closed")

    _later: list[Callable[[], None]]

    def later(self, judge: Callable[[], None]) -> None:
        self.__dict__.setdefault("_later", []).append(judge)

    def left(self, now: float, errors: list[BaseException]) -> None:
        """The block is left: the shafts stand, or it was said that they may not."""
        said = any(isinstance(error, StopUnconfirmed) for error in errors) or any(
            "NOT CONFIRMED" in line or "could not be seen standing" in line for line in self.logged
        )
        for error in errors:
            if not isinstance(error, (BusError, Boom, asyncio.CancelledError)):
                self.fault(f"the block raised {error!r}")
        if self.bus is None:
            return
        for address, drive in self.drives.items():
            drive.beat(now)
            if drive.moves(now) and not said and not (self.for_foreign and address not in self.stop_asked):
                self.fault(f"drive {address} turns after the block was left, and nobody said so")

    def fault(self, what: str) -> None:
        self.wrong.append(what)
