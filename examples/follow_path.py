"""A vehicle on two hub motors follows a path by pure pursuit: it steers for a point of the path some way ahead of it.

python examples/follow_path.py                       # virtual drives
python examples/follow_path.py --port /dev/ttyUSB0 --baudrate 115200
python examples/follow_path.py --plot path.png       # and a picture of the path and of asked, told and measured speed

It needs some metres of room ahead and half a metre to each side.
"""

import argparse
import asyncio
import math
from itertools import pairwise

from rs485bus import DifferentialDrive, Zlac8015d, open_bus
from rs485bus.sim import SimZlac, VirtualLine

SPEED = 0.5
"""Metres a second."""
AHEAD = 0.3
"""Metres from the vehicle to the point that it steers for."""
SLOWING = 0.8
"""Twice the m/s² by which it slows down before the end."""
PATH = [(x / 50, 0.2 * (1 - math.cos(x / 50 * math.pi))) for x in range(126)]
"""Points in metres: 2.5 m ahead, to the left, back and to the left again."""


def steer(x: float, y: float, heading: float, done: int) -> tuple[float, float, int]:
    """How to go from here, in m/s and rad/s, and the point of the path that is steered for; `done` was the last one."""
    goal = done
    while goal < len(PATH) - 1 and math.dist((x, y), PATH[goal]) < AHEAD:
        goal += 1
    away = math.dist((x, y), PATH[goal])
    angle = math.atan2(PATH[goal][1] - y, PATH[goal][0] - x) - heading
    v = min(SPEED, math.sqrt(SLOWING * away)) if goal == len(PATH) - 1 else SPEED
    return v, v * 2 * math.sin(angle) / max(away, AHEAD), goal


def off(x: float, y: float) -> float:
    """Metres from the path."""
    return min(_distance((x, y), a, b) for a, b in pairwise(PATH))


def _distance(point: tuple[float, float], a: tuple[float, float], b: tuple[float, float]) -> float:
    ahead, along = (b[0] - a[0], b[1] - a[1]), (point[0] - a[0], point[1] - a[1])
    part = (ahead[0] * along[0] + ahead[1] * along[1]) / (ahead[0] ** 2 + ahead[1] ** 2)
    part = min(max(part, 0.0), 1.0)
    return math.dist(along, (part * ahead[0], part * ahead[1]))


async def main(port: str | VirtualLine, baudrate: int, plot: str | None) -> None:
    rows: list[tuple[float, ...]] = []
    async with open_bus(port, baudrate=baudrate) as bus:
        base = Zlac8015d(bus, 1, reverse=(False, True))  # the right wheel is mounted mirrored
        vehicle = DifferentialDrive(base, wheel_radius=0.085, track=0.4)
        async with base.watchdog(1.0):
            await base.enable()
            await vehicle.reset()  # here and so it begins
            async with vehicle.stream(timeout=0.3, acceleration=0.5, angular_acceleration=3.0) as setpoint:
                begun, goal = asyncio.get_running_loop().time(), 0
                async for pose in vehicle.poses(every=0.05):
                    v, omega, goal = steer(pose.x, pose.y, pose.heading, goal)
                    if math.dist((pose.x, pose.y), PATH[-1]) < 0.03 or pose.x > PATH[-1][0]:
                        break
                    setpoint(v, omega)
                    now = asyncio.get_running_loop().time() - begun
                    rows.append((now, v, omega, *setpoint.sent, *setpoint.measured, pose.x, pose.y))
                    if len(rows) % 10 == 0:
                        print(
                            f"x {pose.x:5.2f} m   y {pose.y:5.2f} m   {100 * off(pose.x, pose.y):4.1f} cm off the path"
                        )
            pose = await vehicle.update()
    print(f"stands at x {pose.x:.2f} m, y {pose.y:.2f} m")
    if plot is not None:
        draw(rows, plot)


def draw(rows: list[tuple[float, ...]], file: str) -> None:
    """A picture of the path and of the speeds."""
    from matplotlib import pyplot

    times, *columns, xs, ys = zip(*rows, strict=True)
    figure, (way, ahead, about) = pyplot.subplots(3, 1, figsize=(8, 9), layout="constrained")
    way.plot(*zip(*PATH, strict=True), label="path")
    way.plot(xs, ys, label="went")
    way.set(xlabel="m", ylabel="m", aspect="equal")
    for picture, curves, unit in ((ahead, columns[0::2], "m/s"), (about, columns[1::2], "rad/s")):
        for name, curve in zip(("asked", "told", "measured"), curves, strict=True):
            picture.step(times, curve, label=name, where="post")
        picture.set(xlabel="s", ylabel=unit)
    for picture in (way, ahead, about):
        picture.legend()
    figure.savefig(file)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="A vehicle follows a path.")
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual drives")
    parser.add_argument("--baudrate", type=int, default=115200)
    parser.add_argument("--plot", metavar="FILE", help="draw the path, and asked, told and measured speed")
    given = parser.parse_args()
    line = given.port or VirtualLine(SimZlac(1), baudrate=given.baudrate)
    asyncio.run(main(line, given.baudrate, given.plot))
