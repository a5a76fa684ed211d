"""How often axes can be told another speed: learned from all streams of a pair at once, on virtual drives.

How often each drive has its turn depends on what else is sent between, and that on what the drives do. The streams
themselves know it best.
"""

from __future__ import annotations

import asyncio
import itertools
from collections import Counter
from collections.abc import Sequence
from contextlib import AsyncExitStack
from typing import Any

from rs485bus.bus.record import Record
from rs485bus.errors import LimitExceeded, NotSupported
from rs485bus.planning.frames import Frame, frame_of

OFTEN = 0.004
"""Seconds between two set-points: that is more often than they can be sent."""
_SETTLES = 1.0
_ENOUGH = 20
"""Set-points to the slowest axis that are listened to."""
_AT_LEAST, _AT_MOST = 2.0, 30.0
"""Seconds for which they are listened to."""
_SPEEDS = range(10, 40)
"""rpm."""


async def between_set_points(axes: Sequence[Any], often: float = OFTEN) -> tuple[dict[Frame, float], float]:
    """Stream to all axes as fast as can be, and listen.

    Args:
        axes: of virtual drives on one bus, enabled.
        often: seconds between two set-points.

    Returns:
        How many of which frames are sent from one set-point of the slowest axis to its next, and how many seconds that
        takes. Nothing and 0 where they cannot be streamed, or may not turn at once, for they could not be looked at.
    """
    now, sent = asyncio.get_running_loop().time, list[Record]()
    try:
        async with AsyncExitStack() as streams:
            tell = [await streams.enter_async_context(axis.stream(timeout=1.0)) for axis in axes]
            speeds = itertools.cycle(_SPEEDS)

            async def tell_all() -> None:
                speed = float(next(speeds))
                for set_point in tell:
                    set_point(speed)
                await asyncio.sleep(often)

            settled = now() + _SETTLES
            while now() < settled:
                await tell_all()
            told: list[list[float]] = [[] for _ in tell]
            counts = [set_point.count for set_point in tell]
            end = axes[0].bus.subscribe(sent.append)
            while now() < settled + (_AT_LEAST if min(map(len, told)) > _ENOUGH else _AT_MOST):
                await tell_all()
                for times, set_point, count in zip(told, tell, counts, strict=True):
                    times += [now()] * (set_point.count - count)
                counts = [set_point.count for set_point in tell]
            end()
    except (LimitExceeded, NotSupported):
        return {}, 0.0
    times = min(told, key=len)
    if len(times) < 2:
        return {}, 0.0
    first, last, count = times[0], times[-1], len(times) - 1
    frames = Counter(frame_of(record) for record in sent if first < record.ended_at <= last)
    return {frame: number / count for frame, number in frames.items()}, (last - first) / count
