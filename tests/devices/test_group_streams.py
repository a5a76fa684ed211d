"""Where one axis of a streamed group fails, the others are stopped before anybody is told."""

import asyncio

import pytest

from rs485bus import Urgency
from rs485bus.errors import BusError, MotionError, MoveCancelled
from tests.devices.group_plant import Plant, plant
from tests.devices.mks.bench import on_virtual_clock
from tests.devices.test_group_endings import ALL, WHO, fail, standing

HOW = pytest.mark.parametrize("how", ["set-point", "reached", "end of the block"])


def stopped(p: Plant) -> set[int]:
    """The addresses to which a stop was sent, or is on the wire now."""
    sent = {record.address for bus in p.buses for record in bus.flight if record.urgency is Urgency.STOP}
    out = [bus.owner.pair.job for bus in p.buses]
    return sent | {job.address for job in out if job is not None and job.urgency is Urgency.STOP}


async def told(p: Plant, who: str, how: str) -> set[int]:
    """Stream, have one fail; the addresses to which a stop had gone when that was told."""
    seen: set[int] = set()
    with pytest.raises(MotionError) as caught:
        async with p.group.stream(timeout=30.0, acceleration=500.0) as setpoint:
            setpoint(a=200, b=200, c=100)
            await asyncio.sleep(1.0)
            fail(p, who)
            try:
                if how == "reached":
                    while True:
                        setpoint(a=210, b=190, c=110)
                        await setpoint.reached()
                        await asyncio.sleep(0.001)
                while how == "set-point":
                    setpoint(a=210, b=190, c=110)
                    await asyncio.sleep(0.0005)
                if who == "a":
                    await asyncio.sleep(0.6)  # a stall has to show, while it is told to turn
            except BusError:
                seen = stopped(p)
                raise
    assert not isinstance(caught.value, MoveCancelled)  # nobody is told less than why
    return seen or stopped(p)


@WHO
@HOW
@pytest.mark.parametrize("pairs", [1, 2])
@on_virtual_clock
async def test_a_fault_of_one_is_told_when_the_stops_of_the_others_are_on_the_wire(
    who: str, how: str, pairs: int
) -> None:
    async with plant(*ALL, pairs=pairs) as p:
        others = {at for at, name in enumerate("abc", start=1) if name != who}
        assert others <= await told(p, who, how)
        await standing(p)
