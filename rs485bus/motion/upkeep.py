"""Steps of plans that concern the drive, not the motion of an axis: it is asked though it is offline, guarded, or
restarting, and its other axes are waited for."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.failure import failure
from rs485bus.bus.handle import settle
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.bus.units.motion import Motion
from rs485bus.bus.watchdog.foreign import OPTION
from rs485bus.bus.watchdog.guard import admit_and_arm
from rs485bus.errors import DeviceOffline, NoReply, NotStanding, WatchdogInfeasible
from rs485bus.motion.drive import Drive
from rs485bus.motion.plan import AnswersAgain, Ask, KeepFed
from rs485bus.motion.plan_lock import PlanLock
from rs485bus.motion.stop_control import StopControl
from rs485bus.motion.supervisor import Supervisor

_ASK_AGAIN = 0.02
_GOES_ON = 2.0
"""Seconds after which an axis that nobody here has told to move is not waited for any more."""


async def insist(bus: Bus, step: Ask) -> bytes:
    """Send a request as the bus' own: one to a drive that answers nothing, and is taken for offline, is not sent else.
    Raises as `Bus.ask`."""
    ended: asyncio.Future[Job] = asyncio.get_running_loop().create_future()
    job = Job(step.request, repeat=step.repeat, internal=True, on_end=lambda job: settle(ended, job))
    bus.submit(job)
    if (await asyncio.shield(ended)).outcome is not Outcome.REPLY:
        raise failure(job, bus.flight)
    return job.reply


async def keep_fed(bus: Bus, drive: Drive, step: KeepFed) -> bool:
    """Have a watchdog fed that was set before this program; whether it is fed already, or set by a block.

    Raises:
        WatchdogInfeasible: there is no room for its feeds.
        NoReply: the drive does not answer.
    """
    if bus.owner.feeding.get(drive.address) is not None or bus.owner.units[drive.address].guarded:
        return True  # what a block has set and its drive forgot is not taken for somebody else's
    try:
        fed = await admit_and_arm(bus, drive, step.timeout)
    except WatchdogInfeasible as error:
        error.add_note(
            f"{drive.name} has had its watchdog set to {1000 * step.timeout:g} ms before this program. {OPTION} turns "
            "it off."
        )
        raise
    if not fed:
        raise NoReply(f"{drive.name} stopped answering while it was set up.", address=drive.address)
    return False


async def ask(bus: Bus, supervisor: Supervisor, axis: int, step: Ask, motion: Motion | None) -> bytes:
    """Send a request. Where the drive `turns` the motor then, it is not looked at until it `answers_again`.

    Raises as `Bus.ask`.
    """
    if step.insist:
        return await insist(bus, step)
    if step.turns:
        supervisor.begin(axis)
    try:
        return await bus.ask(
            step.request, repeat=step.repeat, reply_timeout=step.reply_timeout, moves=step.turns, motion=motion
        )
    except BaseException:
        if step.turns:
            _look_again(supervisor, axis)
        raise


async def answers_again(bus: Bus, supervisor: Supervisor, axis: int, step: AnswersAgain) -> bool:
    """Wait until a drive that was away answers twice that it is ready; False if it does not in its time."""
    late, answers = bus.now() + step.timeout, 0
    try:
        await anyio.sleep(step.pause)
        while answers < 2:
            try:
                answers = answers + 1 if step.ready(await bus.ask(step.request)) else 0
            except (NoReply, DeviceOffline):
                answers = 0
            if bus.now() > late:
                return False
            await anyio.sleep(step.pause)
        return True
    finally:
        _look_again(supervisor, axis)


def _look_again(supervisor: Supervisor, axis: int) -> None:
    """Whatever the drive does, nobody else sees to it now."""
    supervisor.leave(axis)
    supervisor.review()


async def others_stand(
    bus: Bus, name: str, others: Sequence[Motion], controls: Iterable[StopControl], plans: PlanLock
) -> None:
    """Wait until others of a drive's axes stand: for as long as they do what they were told here, or are stopped.

    Raises:
        NotStanding: one of them goes on though nobody here waits for it.
    """
    controls, waited_for_at = tuple(controls), bus.now()
    while any(motion.may_move for motion in others):
        if any(each.queue.current is not None or each.is_stopping for each in controls):
            waited_for_at = bus.now()
        elif bus.now() > waited_for_at + _GOES_ON:
            raise NotStanding(
                f"{name} waits for another axis of its drive, which turns, or says so, though nobody here has "
                "told it to. See what turns it, and stop() it first."
            )
        await plans.step_aside(_ASK_AGAIN)
