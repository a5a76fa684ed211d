"""How an MKS drive finds its origin, and goes back to it. Source: MKS RTU V1.0.9, 5."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import anyio

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import write
from rs485bus.devices.mks.homing import Homing, SingleTurnHoming, homing_frames
from rs485bus.devices.mks.values import GoHome, Homed
from rs485bus.devices.move import Move, MoveState
from rs485bus.devices.travel import Look
from rs485bus.errors import DeviceOffline, HomingFailed, NoReply, NotEnabled, OutcomeUnknown, RequestFailed
from rs485bus.wire.frames import Request

_POLL = 0.05
_ATTEMPTS = 3
_SINGLE_TURN, _ORIGIN = 0, 1
"""The halves of 0x3B."""


class _Search(NamedTuple):
    """What is being looked for."""

    how: GoHome
    half: int | None
    """Which half of the homing status is its own; None where only the drive knows."""
    timeout: float


class MksOrigin(MksDrive):
    """Homing."""

    def home(self, homing: Homing | None = None, *, timeout: float = 60.0) -> Move:
        """Find the origin, and make it zero (5.1).

        Args:
            homing: `SwitchHoming`, `StopHoming` or `SingleTurnHoming`; None for what the drive is set up for.
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.

        Raises:
            LimitExceeded: a value is out of its range; nothing is queued.
            TypeError: one is of a wrong type; nothing is queued.
        """
        frames = [] if homing is None else homing_frames(self.address, self.model, homing)
        half = None if homing is None else _SINGLE_TURN if isinstance(homing, SingleTurnHoming) else _ORIGIN
        return self._seek("home", frames, _Search(GoHome.ORIGIN, half, timeout))

    def return_to_zero(self, *, timeout: float = 60.0) -> Move:
        """Go straight to the coordinate zero, at the drive's own speed (5.2). The motor must be enabled.

        Args:
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.
        """
        return self._seek("return to zero", [], _Search(GoHome.COORDINATE, None, timeout))

    def _seek(self, what: str, frames: Sequence[Request], search: _Search) -> Move:
        search = search._replace(timeout=self._time("timeout", search.timeout))
        move = self._new_move(what, 0.0)
        self._planned = 0.0
        self._orders.add(move, lambda: self._carry_out_search(move, frames, search))
        return move

    async def _carry_out_search(self, move: Move, frames: Sequence[Request], search: _Search) -> float:
        before = await self._prepare_search(search.how)
        for request in frames:
            await self._ask_setting(request)
        homed = await self._read_homed()
        self._forget()
        self._drive.ramp_stop = None
        move.state = MoveState.STARTING
        await self._begin_search(move, search.how, before, homed)
        move.state = MoveState.MOVING
        await self._end_search(move, search)
        look = await self._look()
        if search.how is GoHome.ORIGIN:
            self._homed = await self._read_homed()
        elif not self._near(look.position, 0):
            raise await self._why(look, 0)
        else:
            await self._check_came_to_zero(look)
        self._zeroed(look)
        return 0.0

    async def _prepare_search(self, how: GoHome) -> Look:
        if how is GoHome.COORDINATE:
            before = await self._prepare()  # it goes by the zero that is set, so that must be right
            self._way = (before.position, 0)
            return before
        self._check_rearm()
        self._check_mode()
        await self._set_up()
        look = await self._look()
        if self._running or look.moving:
            await self._stand_still()
            look = await self._look()
        if not look.enabled:
            self._enabled = False
            raise NotEnabled(f"{self.name} is not enabled: enable() it first.")
        return look

    async def _begin_search(self, move: Move, how: GoHome, before: Look, homed: tuple[Homed, Homed]) -> None:
        """Start it, once: every write of 0x91 starts it anew (5.3.6)."""
        request = write(self.address, r.GO_HOME, how)
        for attempt in range(_ATTEMPTS):
            move.started_at = self.bus.now()
            try:
                await self.bus.ask(request, repeat=r.GO_HOME.repeat, moves=True, motion=self.motion)
                return
            except OutcomeUnknown as unknown:
                await self._grace()
                try:
                    look, now = await self._look(), await self._read_homed()
                except RequestFailed:
                    self._lost = "nobody knows whether its homing started."
                    await self._block(f"nobody knows whether its homing started ({unknown})")
                    raise unknown from None
                if look.moving or now != homed:
                    return
                if how is GoHome.COORDINATE:
                    self._check_reference(look, before)
                elif not self._near(look.position, before.position):
                    return
                if attempt + 1 == _ATTEMPTS:
                    raise

    async def _end_search(self, move: Move, search: _Search) -> None:
        """Wait until it has ended, and see that it found what it looked for."""
        assert move.started_at is not None
        half = search.half
        while True:
            ended, homed = False, (Homed.NOT_DONE, Homed.NOT_DONE)
            try:
                look, homed = await self._look(quick=True), await self._read_homed()
                begun = self.attached.may_start_until(self.motion)
                ended = not look.moving and look.at > begun and Homed.UNDER_WAY not in homed
            except NoReply:
                pass
            except DeviceOffline as error:
                self._lost = "its drive stopped answering during its homing."
                await self._block(f"its drive stopped answering during {move.what}")
                raise HomingFailed(f"{self.name} stopped answering during {move.what}.") from error
            if half is None and Homed.UNDER_WAY in homed:
                half = homed.index(Homed.UNDER_WAY)
            if ended:
                break
            if self.bus.now() > move.started_at + search.timeout:
                self._lost = "its homing did not end."
                self._begin_stop(emergency=True)
                raise HomingFailed(
                    f"{self.name} has not found its origin within {search.timeout:g} s and was stopped. Check the "
                    "switch, the direction and the speed."
                )
            await anyio.sleep(_POLL)
        self.motion.stands(self.bus.now())
        found = Homed.DONE in homed if half is None else homed[half] is Homed.DONE
        if search.how is GoHome.ORIGIN and not found:
            self._lost = "its homing ended without an origin."
            stalled = " It reports a stall." if await self._read(r.STALLED) else ""
            raise HomingFailed(
                f"{self.name} ended its homing without having found the origin.{stalled} Check the switch, the "
                "homing current and what may block the shaft."
            )
