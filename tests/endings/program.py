"""What a plain program does on the world of `world.py`: it asks, waits, and asks again."""

from __future__ import annotations

from rs485bus.bus.schedule.job import Outcome
from rs485bus.wire.frames import read_holding, write_single
from rs485bus.wire.registers import Repeat
from tests.endings.records import Asked, Setting
from tests.endings.world import World

PLAIN = Setting(echo_config=False)
"""A quiet serial line without echo."""


def read(world: World, register: int = 0, count: int = 2, **options: object) -> Asked:
    """Ask the slave at 10 for some registers."""
    return world.submit(read_holding(10, register, count), **options)


def write(world: World, value: int, register: int = 1, **options: object) -> Asked:
    """Write one of its registers, once."""
    return world.submit(write_single(10, register, value), **{"repeat": Repeat.NEVER, "moves": True, **options})


def work(world: World, times: int = 8) -> list[Asked]:
    """What a program does: reads and writes, one after the other, waiting for each for at most three seconds."""
    asked = []
    for at in range(times):
        asked.append(read(world, at % 3, 1 + at % 3))
        wait(world, asked[-1])
        asked.append(write(world, at))
        wait(world, asked[-1])
    return asked


def wait(world: World, asked: Asked, seconds: float = 6.0) -> None:
    """Let time pass until it has ended, or for so long."""
    end = world.now + seconds
    while not asked.ends and world.now < end:
        world.run(min(end, world.now + 0.002))


def all_done(world: World, asked: list[Asked]) -> None:
    """All of it was answered, and nothing is wrong."""
    assert [one.outcome for one in asked] == [Outcome.REPLY] * len(asked)
    assert world.finish() == []
