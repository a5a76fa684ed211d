"""What the searches of this folder have found, each as small as it can be made, with what the design says of it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine

from rs485bus import Bus, BusConfig, LineSettings, MksServo, open_bus
from rs485bus.bus.schedule.job import Outcome
from rs485bus.errors import StopUnconfirmed
from rs485bus.sim import VirtualClockLoop
from rs485bus.wire.frames import write_single
from rs485bus.wire.registers import Repeat
from tests.endings.cable import Cable
from tests.endings.calls import Boom, leaves
from tests.endings.port import CablePort
from tests.endings.records import Setting
from tests.endings.slaves import Mks, Reaction, Slave
from tests.endings.world import World

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


# Closing


# Ends


def test_a_write_ends_over_an_adapter_whose_echo_lost_its_first_byte() -> None:
    world = World(Setting(echo="damaged"))
    one = world.submit(write_single(10, 1, 5), repeat=Repeat.NEVER, moves=True)
    world.run(world.now + 2.0)
    assert one.ends == 1
    assert one.outcome is Outcome.REPLY
    assert world.finish() == []
