"""What the searches of this folder have found, each as small as it can be made, with what the design says of it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine

import pytest

from rs485bus import Bus, BusConfig, LineSettings, MksServo, open_bus
from rs485bus.bus.schedule.job import Outcome, Urgency
from rs485bus.errors import StopUnconfirmed
from rs485bus.sim import VirtualClockLoop
from rs485bus.wire.frames import read_holding, write_single
from rs485bus.wire.registers import Repeat
from tests.endings.cable import Cable
from tests.endings.calls import Boom, leaves
from tests.endings.port import CablePort
from tests.endings.records import Setting, Step
from tests.endings.slaves import Mks, Reaction, Slave
from tests.endings.world import World, play

PLAIN = Setting(echo_config=False)


class Plant:
    """Two drives and a slave behind a transport, on a virtual clock."""

    def __init__(self, *, echo: str = "", echo_config: object = False) -> None:
        line = LineSettings(baudrate=115_200)
        self.drives = {address: Mks(address) for address in (1, 2)}
        self.slave = Slave(10)
        self.cable = Cable(line.character, line.t35, [*self.drives.values(), self.slave], echo=echo)
        self.port = CablePort(self.cable, line)
        self.config = BusConfig(reply_timeout=0.03, echo=echo_config, close_timeout=2.0)  # type: ignore[arg-type]
        self.turns: dict[int, bool] = {}

    def run(self, program: Callable[[Bus, MksServo, MksServo], Coroutine[object, object, None]]) -> Exception | None:
        """Run a program in a bus' block; return what the block raised. Then it is seen which shafts turn."""

        async def whole() -> Exception | None:
            raised: Exception | None = None
            try:
                async with asyncio.timeout(120), open_bus(self.port, config=self.config) as bus:
                    await program(bus, MksServo(bus, 1), MksServo(bus, 2))
            except Exception as error:
                raised = error
            now = asyncio.get_running_loop().time()
            self.turns = {address: drive.moves(now) for address, drive in self.drives.items()}
            return raised

        loop = VirtualClockLoop()
        asyncio.set_event_loop(loop)
        try:
            task = loop.create_task(whole())
            loop.call_later(400, loop.stop)  # the virtual clock would wait for ever where nothing is to come
            return loop.run_until_complete(task)
        finally:
            asyncio.set_event_loop(None)
            loop.close()


def said_or_stands(plant: Plant, error: Exception | None) -> bool:
    return not any(plant.turns.values()) or any(isinstance(leaf, StopUnconfirmed) for leaf in leaves(error or Boom()))


# Stops


def test_a_status_that_lies_does_not_confirm_a_stop_that_was_lost() -> None:
    """DESIGN 5, Stops: confirmed by a status *and* a position that does not change; a status alone may lie."""
    world = World(Setting(echo_config=False, lying=True))
    world.do_move(1, 60, 0.0)
    world.run(world.now + 0.3)
    world.drives[1].reactions.append(Reaction("deaf"))
    world.do_stop(1, True, False)
    world.run(world.now + 3)
    assert world.stops[0].told
    assert world.finish() == []


def test_a_drive_whose_status_lies_stands_when_the_block_is_left_in_the_middle_of_a_move() -> None:
    plant = Plant()
    plant.drives[1].lies = True

    async def program(bus: Bus, x: MksServo, y: MksServo) -> None:
        move = x.move_to(-50, rpm=120)
        await asyncio.sleep(0.06)
        move.cancel()
        await bus.unit(10).read_holding_registers(0)

    error = plant.run(program)
    assert said_or_stands(plant, error), error


@pytest.mark.parametrize("how", ["bus.emergency_stop", "x.stop", "x.emergency_stop"])
def test_a_stop_in_the_last_line_of_a_block_stops_what_another_program_left_turning(how: str) -> None:
    plant = Plant()

    async def program(bus: Bus, x: MksServo, y: MksServo) -> None:
        plant.drives[1]._go(asyncio.get_running_loop().time(), 0, 60, 1e12)
        if how == "bus.emergency_stop":
            bus.emergency_stop()
        elif how == "x.stop":
            x.stop()
        else:
            x.emergency_stop()
        raise Boom

    error = plant.run(program)
    assert not plant.turns[1], error


def test_a_stop_asked_for_while_the_port_is_away_is_reported_in_bounded_time() -> None:
    """DESIGN 5: everything ends, also when the port is away."""
    world = World(PLAIN)
    world.do_unplug()
    world.do_stop(1, True, False)
    world.run(world.now + 40)
    assert [standing for _, standing in world.stops[0].told] == [False]


def test_who_waits_for_a_stop_is_told_when_the_bus_is_closed() -> None:
    world = World(PLAIN)
    world.drives[1].dead_until = world.now + 1000
    world.do_move(1, 60, 0.0)
    world.run(world.now + 0.5)
    world.do_stop(1, True, False)
    world.do_close()
    assert [standing for _, standing in world.stops[0].told] == [False]


def test_an_emergency_stop_awaited_while_the_port_is_away_ends() -> None:
    plant = Plant()

    async def program(bus: Bus, x: MksServo, y: MksServo) -> None:
        plant.port.vanish()
        await asyncio.sleep(0.01)
        report = await asyncio.wait_for(bus.emergency_stop(), 60)
        assert not report.all_standing

    error = plant.run(program)
    assert not isinstance(error, TimeoutError | AssertionError), error


# Closing


def test_nothing_follows_closing_not_even_a_look_for_a_silent_unit() -> None:
    world = World(PLAIN)
    for _ in range(3):
        world.submit(read_holding(20, 0, 2))
        world.run(world.now + 0.5)
    world.do_close()
    world.run(world.now + 10)
    assert world.wrong == []


# Ends


def test_a_write_ends_over_an_adapter_whose_echo_lost_its_first_byte() -> None:
    world = World(Setting(echo="damaged"))
    one = world.submit(write_single(10, 1, 5), repeat=Repeat.NEVER, moves=True)
    world.run(world.now + 2.0)
    assert one.ends == 1
    assert one.outcome is Outcome.REPLY
    assert world.finish() == []


def test_an_axis_stop_awaited_while_the_port_is_away_ends() -> None:
    plant = Plant()
    took: list[float] = []

    async def program(bus: Bus, x: MksServo, y: MksServo) -> None:
        loop = asyncio.get_running_loop()
        plant.port.vanish()
        await asyncio.sleep(0.01)
        begun = loop.time()
        with pytest.raises(StopUnconfirmed):
            await asyncio.wait_for(x.stop(), 60)
        took.append(loop.time() - begun)

    error = plant.run(program)
    assert any(isinstance(leaf, StopUnconfirmed) for leaf in leaves(error or Boom()))
    assert took
    assert took[0] <= 40


def test_a_watchdog_block_entered_while_the_port_is_away_ends() -> None:
    """DESIGN 6: entering is bounded and can be cancelled, also while the port is away."""
    plant = Plant()
    took: list[float] = []

    async def program(bus: Bus, x: MksServo, y: MksServo) -> None:
        loop = asyncio.get_running_loop()
        plant.port.vanish()
        await asyncio.sleep(0.01)
        begun = loop.time()
        with pytest.raises(Exception):  # noqa: B017, PT011 - whichever says that the port is away
            async with bus.watchdog(x, timeout=1.0):
                pass
        took.append(loop.time() - begun)
        begun = loop.time()
        with pytest.raises(Exception):  # noqa: B017, PT011
            async with asyncio.timeout(0.5), bus.watchdog(y, timeout=1.0):
                pass
        took.append(loop.time() - begun)

    error = plant.run(program)
    assert not isinstance(error, TimeoutError), error
    assert len(took) == 2
    assert took[0] <= 40
    assert took[1] <= 3


SLOW = Setting(baudrate=9600, echo_config=False)


def test_who_was_cut_short_by_stops_waits_no_longer_for_a_busy_device() -> None:
    """DESIGN 5: a device that says it is busy is asked again after a pause, which counts the times it said so."""
    steps = [
        Step(0.0, "read", (10, 0, 1, False, 0, 0.0)),
        Step(0.0, "read", (10, 0, 1, True, 0, 1.99)),
        Step(0.1, "write", (10, 3, 0, False, True, 0.0, False)),
        Step(0.0, "react", (10, Reaction("exception", 6, split=3))),
    ]
    assert play(SLOW, steps).wrong == []


def test_what_was_on_the_wire_at_an_emergency_stop_is_not_sent_again_once_that_is_cleared() -> None:
    """DESIGN 5: an emergency stop drops all that waits; and what would be sent again waits."""
    world = World(SLOW)
    world.slaves[12].dead_until = world.now + 0.05
    world.do_verify(2, 0, 0.0)
    world.run(world.now + 0.01)
    world.do_emergency()
    while len(world.emergencies[0]) == 1:
        world.run(world.now + 0.001)
    world.do_clear()
    world.run(world.now + 5.0)
    assert world.wrong == []
    written = world.asked[0]
    assert (written.job.attempts, written.outcome) == (1, Outcome.UNKNOWN)


# What the bus asks of its own accord


def test_a_stop_among_other_noise_waits_for_silence_anew() -> None:
    """DESIGN 4: a stop waits 20 ms for silence. What was heard before the line was quiet is over, though parts of a
    stop went out meanwhile."""
    steps = [
        Step(0.0, "babble", (0.2, 0.001, 0.001)),
        Step(0.00728, "react", (10, Reaction("late", 0.2794, split=3))),
        Step(0.0, "stop", (1, False, False)),
        Step(0.0, "read", (10, 2, 3, False, int(Urgency.STOP), 0.999)),
        Step(0.2762, "babble", (3.0, 0.001, 0.001)),
    ]
    world = play(Setting(baudrate=9600, echo_config=False, by_silence=False), steps)
    assert world.wrong == []


def test_what_is_asked_of_a_lost_unit_keeps_nobody_waiting_behind_a_gateway() -> None:
    """DESIGN 5: everything ends. A look that is not answered is owed for five seconds, and looks follow each other
    sooner than that."""
    steps = [
        Step(0.0, "write", (20, 1, 0, True, False, 0.0, False)),
        Step(0.0, "read", (20, 3, 2, False, int(Urgency.POLL), 0.0)),
        Step(0.0, "read", (20, 1, 1, True, int(Urgency.STOP), 0.0)),
        Step(0.0, "write", (20, 2, 2, False, True, 0.0, False)),
    ]
    world = play(Setting(gateway=True), steps)
    assert world.wrong == []
