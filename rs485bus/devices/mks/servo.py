"""MKS SERVO28D/35D/42D/57D as an axis. Source: MKS RTU V1.0.9, the section named at each method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import current, read, write
from rs485bus.devices.mks.homing import Homing
from rs485bus.devices.mks.values import GoHome, Homed, Inputs, Model, MotionDirection, Status, WorkMode
from rs485bus.devices.move import Move, MoveState
from rs485bus.errors import HomingFailed, NoReply, OutcomeUnknown, RequestFailed
from rs485bus.wire.frames import Request, payload

_SLOWEST_SETTING = 2.5
"""Seconds that 0x9A may take to answer; 5.6 logs 1.6."""
_HOMING_POLL = 0.05
_ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class MksStatus:
    """What a drive reports of itself."""

    status: Status
    enabled: bool
    homed: Homed
    """By switch or mechanical stop."""
    homed_in_turn: Homed
    stalled: bool
    inputs: Inputs


class MksServo(MksDrive):
    """An MKS SERVO drive and its motor.

    Args:
        bus: the bus it is on.
        address: 1..247.
        model: which drive; it limits the current.
        mode: the work mode it is set to. It cannot be read; `set_mode` sets it. The bus moves it in the SR modes only.
        microsteps: what it is set to, 1..255. At others than 16, 32 and 64 the drive takes speeds for something else
            (7.1); that is compensated for.
        units_per_turn: positions are in units of this many to a turn of the motor; 1 for turns.
        reverse: whether positive is the other way round. Which way the shaft then turns is not promised.
        positive: the direction of 0xF6 in which the position of 0x31 grows. The manual's text and its examples
            disagree (3.1.1, 3.1.2); where `run` goes the other way than `move_to`, it is `MotionDirection.CW`.
        limits: lowest and highest position that may be gone to, in units.
        rpm: the speed of moves that name none.
        acceleration: the acceleration of moves that name none: 78.4..20000 rpm/s.
        tolerance: counts (1/16384 turn) by which a position may differ from its target.

    Raises:
        AddressInUse: there is a facade for this address already.
        LimitExceeded, ValueError: an argument is out of its range.
    """

    def __init__(
        self,
        bus: Bus,
        address: int,
        *,
        model: Model = Model.SERVO42D,
        mode: WorkMode = WorkMode.SR_VFOC,
        microsteps: int = 16,
        units_per_turn: float = 1.0,
        reverse: bool = False,
        positive: MotionDirection = MotionDirection.CCW,
        limits: tuple[float, float] | None = None,
        rpm: float = 300.0,
        acceleration: float = 1000.0,
        tolerance: int = 8,
    ) -> None:
        super().__init__(
            bus,
            address,
            model=model,
            mode=mode,
            microsteps=microsteps,
            units_per_turn=units_per_turn,
            reverse=reverse,
            positive=positive,
            limits=limits,
            rpm=rpm,
            acceleration=acceleration,
            tolerance=tolerance,
        )

    # Verbs

    def home(self, homing: Homing | None = None, *, timeout: float = 60.0) -> Move:
        """Find the origin, and make it zero (5.1).

        Args:
            homing: `SwitchHoming`, `StopHoming` or `SingleTurnHoming`; None for what the drive is set up for.
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.
        """
        frames = [] if homing is None else homing.frames(self.address)
        move = self._new_move("home", 0.0)
        self._planned = 0.0
        self._orders.add(move, lambda: self._home(move, GoHome.ORIGIN, frames, timeout))
        return move

    def return_to_zero(self, *, timeout: float = 60.0) -> Move:
        """Go straight to the coordinate zero, at the drive's own speed (5.2). The motor must be enabled."""
        move = self._new_move("return to zero", 0.0)
        self._planned = 0.0
        self._orders.add(move, lambda: self._home(move, GoHome.COORDINATE, [], timeout))
        return move

    def set_mode(self, mode: WorkMode) -> Handle[None]:
        """Set the work mode, which the drive keeps (3.2.2)."""
        request = write(self.address, r.WORK_MODE, mode)

        async def carry_out() -> None:
            await self.bus.ask(request)
            self.mode = mode
            self._forget()

        return self._order(f"work mode {mode.name}", carry_out)

    def set_current(self, milliamperes: int, *, save: bool = True) -> Handle[None]:
        """Set the working current: 0..3000 mA, of a 57D 0..5200 mA (3.2.3).

        Args:
            milliamperes: the current.
            save: whether the drive keeps it. Without, it holds until a restart and spares the flash.
        """
        return self._setting(f"current {milliamperes} mA", current(self.address, self.model, milliamperes, save))

    # Questions

    async def status(self) -> MksStatus:
        """What the drive reports (3.1.6, 3.1.7, 3.4.3, 4.1, 7.2.1)."""
        status = await self._read(r.STATUS)
        enabled = await self._read(r.ENABLED)
        in_turn, homed = await self._read_homed()
        return MksStatus(status, enabled, homed, in_turn, await self._read(r.STALLED), await self._read(r.INPUTS))

    # Inside

    def _setting(self, what: str, *requests: Request, reply_timeout: float | None = None) -> Handle[None]:
        """Queue the writing of a setting. It may be repeated."""

        async def carry_out() -> None:
            for request in requests:
                await self.bus.ask(request, reply_timeout=reply_timeout)

        return self._order(what, carry_out)

    async def _read_homed(self) -> tuple[Homed, Homed]:
        in_turn, homed = r.HOMED.decode(payload(await self.bus.ask(read(self.address, r.HOMED))))
        return in_turn, homed

    async def _home(self, move: Move, how: GoHome, frames: Sequence[Request], timeout: float) -> float:
        self._check_rearm()
        if self._running:
            await self._stand_still()
        for request in frames:
            slow = request.register == r.SINGLE_TURN.address
            await self.bus.ask(request, reply_timeout=_SLOWEST_SETTING if slow else None)
        before, position = await self._read_homed(), await self._read_position()
        self._forget()
        self._drive.ramp_stop = None
        move.state = MoveState.STARTING
        await self._begin_homing(move, how, before, position)
        move.state = MoveState.MOVING
        assert move.started_at is not None
        while not await self._homing_ended():
            if self.bus.now() > move.started_at + timeout:
                self._begin_stop(emergency=True)
                raise HomingFailed(
                    f"{self.name} has not found its origin within {timeout:g} s and was stopped. Check the switch, "
                    "the direction and the speed."
                )
            await anyio.sleep(_HOMING_POLL)
        self.motion.stands(self.bus.now())
        if how is GoHome.ORIGIN and Homed.DONE not in await self._read_homed():
            raise HomingFailed(f"{self.name} ended its homing without having found the origin.")
        self._zeroed(await self._look())
        return 0.0

    async def _begin_homing(self, move: Move, how: GoHome, before: tuple[Homed, Homed], position: int) -> None:
        """Start it, once: every write of 0x91 starts it anew (5.3.6)."""
        request = write(self.address, r.GO_HOME, how)
        for attempt in range(_ATTEMPTS):
            move.started_at = self.bus.now()
            try:
                await self.bus.ask(request, repeat=r.GO_HOME.repeat, moves=True, motion=self.motion)
                return
            except OutcomeUnknown as unknown:
                try:
                    look, homed = await self._look(quick=True), await self._read_homed()
                except RequestFailed:
                    await self._block(f"nobody knows whether its homing started ({unknown})")
                    raise unknown from None
                if look.moving or homed != before or not self._near(look.position, position):
                    return
                if attempt + 1 == _ATTEMPTS:
                    raise

    async def _homing_ended(self) -> bool:
        try:
            if (await self._look(quick=True)).moving:
                return False
            return Homed.UNDER_WAY not in await self._read_homed()
        except NoReply:
            return False
