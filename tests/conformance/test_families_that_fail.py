"""A family whose own code fails while its motor turns: the motor is stopped, and whoever waits is told an end."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from rs485bus.errors import BusError, StopUnconfirmed
from tests.conformance.acme import AcmeServo
from tests.conformance.subjects import SUBJECTS, now, rig
from tests.devices.mks.bench import on_virtual_clock

ACME = SUBJECTS[-1]
JUDGES = ("ask", "see", "stop_sent")
HOOKS = ("judgement", "stopping_time", "slows_down_for", "may_start_until", *JUDGES)


def fails(*_: Any, **__: Any) -> Any:
    raise RuntimeError("a family's own error")


def break_hook(axis: AcmeServo, hook: str) -> None:
    """Have one hook of its drive fail from now on."""
    drive = axis._acme
    if hook not in JUDGES:
        setattr(drive, hook, fails)
        return
    judgement = drive.judgement

    def judged(motion: Any) -> Any:
        detector = judgement(motion)
        setattr(detector, hook, fails)
        return detector

    drive.judgement = judged  # type: ignore[method-assign]


@pytest.mark.parametrize("hook", HOOKS)
@on_virtual_clock
async def test_a_stop_that_cannot_be_judged_is_sent_and_told_as_not_confirmed(hook: str) -> None:
    with pytest.RaisesGroup(StopUnconfirmed, allow_unwrapped=True):
        async with rig(ACME, count=2) as on:
            await on.axis.run(200)
            break_hook(on.axis, hook)
            async with asyncio.timeout(30):
                with pytest.raises(StopUnconfirmed):
                    await on.axis.stop()
            assert not ACME.motor(on.sim).moving(now())
            await on.axes[1].move_by(1.0)


@pytest.mark.parametrize("hook", [*HOOKS, "on_sent", "effects", "broadcast_stop"])
@on_virtual_clock
async def test_an_emergency_stop_reaches_all_whatever_fails(hook: str) -> None:
    try:
        async with rig(ACME, count=2) as on:
            for axis in on.axes:
                await axis.run(200)
            break_hook(on.axis, hook)
            async with asyncio.timeout(30):
                report = await on.bus.emergency_stop()
            assert not any(ACME.motor(sim).moving(now()) for sim in on.sims)
            assert report.devices[1].standing
    except* BusError:
        assert hook in HOOKS


@pytest.mark.parametrize("hook", ["on_sent", "effects"])
@on_virtual_clock
async def test_a_stop_goes_out_though_who_is_told_of_it_fails(hook: str) -> None:
    async with rig(ACME) as on:
        await on.axis.run(200)
        break_hook(on.axis, hook)
        async with asyncio.timeout(30):
            await on.axis.stop()
        assert not ACME.motor(on.sim).moving(now())
