"""How a TL-R drive finds its origin. Source: TL-R manual, 3.4."""

from __future__ import annotations

from dataclasses import dataclass

import anyio

from rs485bus.arguments import choice, instance, real
from rs485bus.devices.move import Move, MoveState
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.drive import TlrDrive
from rs485bus.devices.tlr.knowledge import TlrLook
from rs485bus.devices.tlr.values import ControlWord, HomingMode, StatusWord
from rs485bus.errors import (
    DeviceOffline,
    HomingFailed,
    LimitExceeded,
    NoReply,
    NotEnabled,
    OutcomeUnknown,
    RequestFailed,
)
from rs485bus.wire.registers import Repeat

_POLL = 0.02
_PAUSE = 1.0
"""Seconds for which it may stand where it turns round. One that stands for longer has ended."""
_ATTEMPTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Homing:
    """How to find the origin.

    With `NEGATIVE_LIMIT` and `POSITIVE_LIMIT` it goes to that limit switch at `rpm`, back off it, and to it again at
    `creep_rpm`. With `POSITIVE_ORIGIN` it does so with the origin switch, from below. With `NEGATIVE_ORIGIN` it goes
    down across the origin switch until that opens again, and up to it at `creep_rpm`. `HERE` is where it stands.
    """

    mode: HomingMode
    rpm: int = 60
    """0..3000."""
    creep_rpm: int = 20
    """0..3000."""
    ramp_ms: int = 100
    """Up to `rpm` and down from it: 0..2000."""
    offset: float = 0.0
    """In units of the axis. Whether it goes there afterwards, or the origin has that position, is up to the drive."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "mode", choice("mode", self.mode, HomingMode))
        real("offset", self.offset)


class TlrHoming(TlrDrive):
    """A drive that finds its origin."""

    def home(self, homing: Homing | None = None, *, timeout: float = 60.0) -> Move:
        """Find the origin. Positions can be trusted then, and soft limits count.

        The handle gives the position reached: 0, unless there is an offset.

        Args:
            homing: how; None for what the drive is set to.
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.

        Raises:
            LimitExceeded: a value is out of its range; nothing is queued.
            TypeError: one is of a wrong type; nothing is queued.
        """
        timeout = self._time("timeout", timeout)
        if homing is not None:
            instance("homing", homing, Homing, "Homing(mode=HomingMode.NEGATIVE_LIMIT)")
            r.HOMING.encode(homing.mode, homing.rpm, homing.creep_rpm, homing.ramp_ms, 0)
            if not (homing.rpm and homing.creep_rpm):
                raise LimitExceeded(f"{self.name}: it never finds its origin at 0 rpm")
        at_zero = homing is not None and homing.offset == 0
        move = self._new_move("home", 0.0 if at_zero else None)
        self._planned = 0.0 if at_zero else None
        self._orders.add(move, lambda: self._home(move, homing, timeout))
        return move

    async def _home(self, move: Move, homing: Homing | None, timeout: float) -> float:
        before = await self._ready_to_home()
        mode = await self.link.read(r.HOMING_MODE) if homing is None else homing.mode
        await self._check_input(mode)
        if homing is not None:
            offset = self._to_counts(homing.offset)
            await self.link.put(r.HOMING, mode, homing.rpm, homing.creep_rpm, homing.ramp_ms, offset)
        self._forget()
        move.state = MoveState.STARTING
        await self._begin_homing(move, before)
        move.state = MoveState.MOVING
        await self._see_it_home(move, before, mode, timeout)
        look = await self._look()
        self.motion.stands(look.at)
        if look.restarted:
            raise self._reference_lost()
        if mode is HomingMode.HERE and homing is not None and homing.offset == 0 and not self._near(look.position, 0):
            raise HomingFailed(f"{self.name} was to be at zero where it stands, and reports {look.position} pulses.")
        self._lost = ""
        self._enabled = look.enabled
        self._commanded, self._seen = look.position, look
        move.target = self._to_units(look.position)
        return move.target

    async def _ready_to_home(self) -> TlrLook:
        """As before a move, but for the reference, which is about to be found."""
        self._check_rearm()
        await self._set_up()
        look = await self._look()
        if look.moving or self._running:
            await self._stand_still()
            look = await self._look()
        if not look.enabled:
            raise NotEnabled(f"{self.name} is not enabled: enable() it first.")
        self._check_fault(look.report)
        self._gone = False
        return look

    async def _check_input(self, mode: HomingMode) -> None:
        """Homing by a switch that no input has would never end (3.4.3)."""
        needed = mode.needs
        if needed is not None and needed not in await self.link.read_words(r.ALL_INPUT_FUNCTIONS):
            raise HomingFailed(
                f"{self.name}: no input has the function {needed.name}, so that homing {mode.name} would never end. "
                f"Nothing was started. Assign it: inputs[0] = DiFunction.{needed.name}."
            )

    async def _begin_homing(self, move: Move, before: TlrLook) -> None:
        """Start it, once."""
        for attempt in range(_ATTEMPTS):
            await self._clear()
            move.started_at = self.bus.now()
            try:
                await self.link.control(ControlWord.HOME, Repeat.VERIFY)
                return
            except OutcomeUnknown as unknown:
                try:
                    look = await self._look(quick=True)
                except RequestFailed:
                    await self._block(f"nobody knows whether its homing started ({unknown})")
                    raise unknown from None
                if self._differs(look, before):
                    return
                if attempt + 1 == _ATTEMPTS:
                    raise

    def _differs(self, look: TlrLook, before: TlrLook) -> bool:
        """Whether something happened."""
        return look.moving or _homed(look) is not _homed(before) or not self._near(look.position, before.position)

    async def _see_it_home(self, move: Move, before: TlrLook, mode: HomingMode, timeout: float) -> None:
        """Wait until it says that it is homed and stands, and has been seen to do something for it.

        The drive may have been homed before. So that it says so proves nothing as long as it was not seen to take that
        back, unless it stands for long enough.
        """
        assert move.started_at is not None
        started = mode is HomingMode.HERE
        fresh = not _homed(before)
        stood_since = None
        while True:
            look = await self._look_while_homing(move)
            if look is not None:
                self._check_fault(look.report)
                started = started or self._differs(look, before)
                fresh = fresh or not _homed(look)
                stood_since = None if look.moving else stood_since or look.at
                if stood_since is not None and look.at > move.started_at + self._drive.start_grace:
                    long = look.at - max(stood_since, move.started_at) > _PAUSE
                    if started and _homed(look) and (fresh or long or mode is HomingMode.HERE):
                        return
                    if long:
                        await self._stand_still()
                        raise HomingFailed(
                            f"{self.name} {'stands without having found its origin' if started else 'did not start'}, "
                            f"with inputs {look.report.inputs!r}. Check the switch, the direction and the speed."
                        )
            if self.bus.now() > move.started_at + timeout:
                self._begin_stop(emergency=True)
                raise HomingFailed(
                    f"{self.name} has not found its origin within {timeout:g} s and was stopped. Check the switch, "
                    "the direction and the speed."
                )
            await anyio.sleep(_POLL)

    async def _look_while_homing(self, move: Move) -> TlrLook | None:
        try:
            return await self._look(quick=True)
        except NoReply:
            return None
        except DeviceOffline as error:
            self._lost = "its drive stopped answering and may have restarted."
            await self._block(f"its drive stopped answering during {move.what}")
            raise HomingFailed(f"{self.name} stopped answering during {move.what}.") from error


def _homed(look: TlrLook) -> bool:
    return StatusWord.HOMED in look.report.status
