"""Ctrl-C in the middle of a move, in a real process on a real port, in real time."""

import asyncio
import signal
import sys

import pytest

from rs485bus.sim import SimMks, VirtualLine
from tests.real.support import in_real_time, posix, running

pytestmark = posix

SCRIPT = """
import asyncio, sys
from rs485bus import AxisGroup, MksServo, open_bus

async def main():
    async with open_bus(sys.argv[1], baudrate=115200) as bus:
        axes = [MksServo(bus, address) for address in (1, 2)]
        async with bus.watchdog(*axes, timeout=1.0):
            for axis in axes:
                axis.enable()
            await turn(*axes)

asyncio.run(main())
"""
ALONE = """
async def turn(x, y):
    await asyncio.gather(x.run(600), y.run(600))
    print("turning", flush=True)
    await x.move_to(1000.0)
"""
GROUP = """
async def turn(x, y):
    move = AxisGroup(x=x, y=y).move_to(x=1000.0, y=1000.0)
    while move.skew is None:
        await asyncio.sleep(0.01)
    await asyncio.sleep(0.1)
    print("turning", flush=True)
    await move
"""


@pytest.mark.parametrize("presses", [1, 2, 10])
@pytest.mark.parametrize("turn", [ALONE, GROUP], ids=["alone", "group"])
def test_ctrl_c_stops_every_axis_and_turns_the_watchdogs_off(presses: int, turn: str) -> None:
    async def main() -> None:
        sims = [SimMks(1), SimMks(2)]
        line = VirtualLine(*sims, baudrate=115200)
        loop = asyncio.get_running_loop()
        async with await line.serve_pty() as port:
            async with running(sys.executable, "-c", turn + SCRIPT, port.path, ready="turning") as process:
                assert any(sim.moving(loop.time()) for sim in sims)
                for _ in range(presses):
                    process.send_signal(signal.SIGINT)
                    await asyncio.sleep(0.003)
                output = await asyncio.wait_for(process.communicate(), 10)
            assert b"KeyboardInterrupt" in output[0]
            assert not any(sim.moving(loop.time()) for sim in sims)
            assert [sim.watchdog_ms for sim in sims] == [0, 0]
            assert [sim.trips for sim in sims] == [[], []]

    in_real_time(main)


LEAVING = """
async def turn(x, y):
    await asyncio.gather(x.run(600), y.run(600))
    print("turning", flush=True)
    async with asyncio.TaskGroup() as group:
        group.create_task(leave())
        await x.move_to(1000.0)

async def leave():
    sys.exit(3)
"""


def test_a_program_that_exits_in_one_of_its_tasks_stops_every_axis_and_ends() -> None:
    async def main() -> None:
        sims = [SimMks(1), SimMks(2)]
        line = VirtualLine(*sims, baudrate=115200)
        loop = asyncio.get_running_loop()
        async with await line.serve_pty() as port:
            async with running(sys.executable, "-c", LEAVING + SCRIPT, port.path, ready="turning") as process:
                assert await asyncio.wait_for(process.wait(), 10) == 3
            assert not any(sim.moving(loop.time()) for sim in sims)
            assert [sim.watchdog_ms for sim in sims] == [0, 0]

    in_real_time(main)


def test_a_process_that_is_killed_leaves_the_drives_to_their_watchdogs() -> None:
    async def main() -> None:
        sims = [SimMks(1), SimMks(2)]
        line = VirtualLine(*sims, baudrate=115200)
        loop = asyncio.get_running_loop()
        async with await line.serve_pty() as port:
            async with running(sys.executable, "-c", ALONE + SCRIPT, port.path, ready="turning") as process:
                process.kill()
                await process.wait()
            await asyncio.sleep(1.2)
            assert not any(sim.moving(loop.time()) for sim in sims)
            assert any(sim.trips for sim in sims)

    in_real_time(main)
