"""What is done to an MKS drive outside of its work. Source: MKS RTU V1.0.9, the section named at each method.

What takes a drive away from the bus for a while is refused while any watchdog on the bus is armed.
"""

from __future__ import annotations

import asyncio
from typing import TypeVar

import anyio

from rs485bus.bus.failure import failure
from rs485bus.bus.handle import Handle, settle
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.bus.stopping.halt import Procedure
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.adapter import MksWatchdog
from rs485bus.devices.mks.alarms import AFTER_CALIBRATION, AFTER_RESTART, STALLED, Alarm, hints
from rs485bus.devices.mks.frames import write, write_block
from rs485bus.devices.mks.settings import MksProfile, check_outputs
from rs485bus.devices.mks.setup import MksSetup
from rs485bus.devices.mks.values import Boot, OutputMask, PowerOnRun, Status
from rs485bus.errors import DeviceOffline, DeviceRefused, LimitExceeded, MotionError, MotorStalled, NoReply, NotSent
from rs485bus.wire.registers import Register

T = TypeVar("T")

_SETTLES = 1.0
"""Seconds in which a drive that was told to restart is not asked anything: it may still answer before it does."""
_ASK_EVERY = 1.0


class MksService(MksSetup):
    """Outputs, stalls, restarts, silence, and what the drive does at power-on."""

    _silent = False

    def set_outputs(
        self, *, out_1: bool | OutputMask = OutputMask.LEAVE, out_2: bool | OutputMask = OutputMask.LEAVE
    ) -> Handle[None]:
        """Set the outputs of a 57D (4.2). They fall back at power-off.

        Args:
            out_1: its level, or what else is done with it. The manual has two ways not to write one, `LEAVE` (the
                default there, too) and `HOLD`; whether they differ only hardware tells.
            out_2: the same.

        Raises:
            NotSupported: another drive than a 57D; nothing is queued.
        """
        check_outputs(self.model)
        request = write_block(self.address, r.OUTPUTS, *_output(out_2), *_output(out_1))
        return self._order("outputs", lambda: self._ask_setting(request))

    def release_stall(self) -> Handle[None]:
        """End the state of a stall (3.4.4). The motor then holds again where the drive says `enabled`."""

        async def carry_out() -> None:
            await self._ask_setting(write(self.address, r.RELEASE_STALL, 1))
            self._seen = None
            if await self._read(r.STALLED):
                raise MotorStalled(f"{self.name} still reports a stall. {hints([STALLED])}")
            self._enabled = await self._read(r.ENABLED)

        return self._order("release of a stall", carry_out)

    def set_power_on_run(self, on: bool, *, while_running: bool = False) -> Handle[None]:
        """Whether the drive runs by itself when it is switched on, as its last speed command said (8.3).

        **It will then turn without anybody telling it to.** The motor must stand: `run`, `stop`, then this. Whether a
        drive still knows its last speed command then only hardware tells; try it with a free shaft.

        Args:
            on: whether it does.
            while_running: send it while the motor turns, as 8.5 logs it; the motor then slows down and stops.
        """
        request = write(self.address, r.POWER_ON_RUN, PowerOnRun.SAVE if on else PowerOnRun.CLEAR)

        async def carry_out() -> None:
            if not while_running:
                await self._must_stand("power-on run")
            await self._ask_setting(request)

        return self._order("power-on run", carry_out)

    def set_heartbeat(self, seconds: float) -> Handle[None]:
        """The time after which the drive stops its motor where it hears nothing: 0 (off) to 4294967.295 s (3.2.14).

        `watchdog` sets it and keeps it fed; where it is set like this, nobody feeds it.

        Raises:
            LimitExceeded: out of range; nothing is queued.
        """
        wanted = self._number("heartbeat time", seconds) * 1000
        if not wanted == 0 and not 1 <= wanted <= MksWatchdog.highest:  # less than one would turn it off
            raise LimitExceeded(
                f"{self.name}: heartbeat time {seconds:g} s is outside 0.001..{MksWatchdog.highest / 1000} s; 0 is off"
            )
        request = write(self.address, r.WATCHDOG, round(wanted))

        async def carry_out() -> None:
            if self.bus.owner.feeding.get(self.address) is not None:
                raise MotionError(f"{self.name} is guarded by a watchdog block, which sets its heartbeat time.")
            await self._ask_setting(request)

        return self._order("heartbeat time", carry_out)

    # Away for a while

    def calibrate(self, *, timeout: float = 60.0) -> Handle[None]:
        """Calibrate the encoder (3.2.1). The shaft must be free: it turns by itself, and the drive restarts.

        Whether it succeeded cannot be read; the screen tells (`alarms.AFTER_CALIBRATION`). Then `enable` and home.

        Args:
            timeout: seconds after which a drive that has not come back makes the handle raise `MotionError`.
        """
        return self._restarting("calibration", r.CALIBRATE, timeout, AFTER_CALIBRATION)

    def restart(self, *, timeout: float = 10.0) -> Handle[None]:
        """Start the drive anew (3.5.2). It counts from zero then: `enable`, and `home` or `set_zero`. As `calibrate`
        otherwise."""
        return self._restarting("restart", r.RESTART, timeout, AFTER_RESTART)

    def factory_reset(self, *, timeout: float = 10.0) -> Handle[None]:
        """Make all settings those of the factory, and restart (3.5.1). As `restart` otherwise.

        Do it with no other drive on the pair: whether address and baud rate are reset, too, only hardware tells, and
        then it answers at address 1 and 38400 bit/s. Work mode and microsteps are written again before it moves.
        """

        return self._restarting("factory reset", r.FACTORY_RESET, timeout, AFTER_RESTART)

    def silence(self) -> Handle[None]:
        """Have the drive answer nothing, so that another one's firmware can be loaded, until `wake` (3.6).

        The motor must stand. The drive cannot be stopped over the bus meanwhile.
        """

        async def carry_out() -> None:
            await self._must_stand("silence")
            await self._ask_setting(write(self.address, r.BOOT, Boot.ENTER_SILENCE))
            self._silent = True

        return self._order("silence", carry_out)

    def wake(self) -> Handle[None]:
        """Have a silent drive answer again (3.6), also one that some other program silenced."""
        handle: Handle[None] = Handle(f"wake of {self.name}", self._unseen)
        job = Job(write(self.address, r.BOOT, Boot.LEAVE_SILENCE), internal=True)

        async def carry_out() -> None:
            ended: asyncio.Future[Job] = asyncio.get_running_loop().create_future()
            # The bus' own job: a drive that answers nothing is taken for offline, and others would not be sent.
            self.bus.start(_send(job), lambda job: settle(ended, job))
            if (await ended).outcome is not Outcome.REPLY:
                raise failure(job, self.bus.flight)
            self._silent = False

        self._orders.add(handle, carry_out)
        return handle

    def enter_boot(self) -> Handle[None]:
        """Restart the drive into its boot mode, where it waits for firmware (3.6). It answers no Modbus from then on.

        The motor must stand; `silence` all other drives first. Switched off and on, it works as before.
        """

        async def carry_out() -> None:
            await self._must_stand("boot mode")
            await self._restart_by(r.BOOT, Boot.ENTER_BOOT)
            self._blocked = "it was sent to boot mode"

        return self._order("boot mode", carry_out)

    # Inside

    def check_ready(self) -> None:
        super().check_ready()
        if self._silent:
            raise MotionError(f"{self.name} was silenced and answers nothing: wake() it first.")

    def _restarting(
        self, what: str, register: Register[int], timeout: float, alarms: tuple[Alarm, ...]
    ) -> Handle[None]:
        async def carry_out() -> None:
            await self._must_stand(what)
            await self._restart_by(register, 1)
            if register is r.FACTORY_RESET:
                self.acknowledged = MksProfile()
                self._unsure = frozenset({"mode", "microsteps"})
            if not await self._comes_back(timeout):
                raise MotionError(f"{self.name} has not come back within {timeout:g} s of its {what}. {hints(alarms)}")

        return self._order(what, carry_out)

    async def _restart_by(self, register: Register[T], value: T) -> None:
        """Tell it to restart; unless that surely did not happen, nothing that was known of it holds any more."""
        lost, self._lost = self._lost, "it was restarted."
        try:
            await self.bus.ask(write(self.address, register, value), repeat=register.repeat)
        except (NotSent, DeviceRefused):
            self._lost = lost
            raise
        self._enabled = None
        self._forget()

    async def _comes_back(self, timeout: float) -> bool:
        """Wait until it answers, twice in a row: it may do so once more before it restarts."""
        late = self.bus.now() + timeout
        answers = 0
        await anyio.sleep(_SETTLES)
        while answers < 2:
            try:
                answers = 0 if await self._read(r.STATUS) is Status.CALIBRATING else answers + 1
            except (NoReply, DeviceOffline):
                answers = 0
            if self.bus.now() > late:
                return False
            await anyio.sleep(_ASK_EVERY)
        return True


def _output(wanted: bool | OutputMask) -> tuple[OutputMask, bool]:
    return (wanted, False) if isinstance(wanted, OutputMask) else (OutputMask.WRITE, wanted)


def _send(job: Job) -> Procedure[Job]:
    yield job
    return job
