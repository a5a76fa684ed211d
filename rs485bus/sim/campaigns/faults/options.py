"""Readings of the manuals and quirks of drives that every scenario is run with."""

from __future__ import annotations

from collections.abc import Callable, Container

from rs485bus.devices.mks import Status
from rs485bus.devices.tlr import OperatingMode
from rs485bus.devices.zlac import ShaftState
from rs485bus.devices.zlac import registers as zlac
from rs485bus.sim.campaigns.faults.plant import Drive, Option
from rs485bus.sim.mks_quirks import Quirks
from rs485bus.sim.treatment import PLAIN as WELL
from rs485bus.sim.treatment import Treatment

PLAIN = Option("As the manual reads at first sight.")

_EVERY = 7
_LATE = 0.7
_FLASH_TAKES = 0.25
_MKS_SETTINGS = range(0x82, 0xA0)
_TLR_SETTINGS = range(0x10, 0x30)


def _late_while_moving(drive: Drive, frame: bytes, now: float) -> Treatment:
    return Treatment(delay=_LATE) if drive.heard % _EVERY == 0 and drive.turns(now) else WELL


def _busy(drive: Drive, frame: bytes, now: float) -> Treatment:
    return Treatment(code=6, carried_out=False) if drive.heard % _EVERY == 0 else WELL


def _slow_flash(kept: Container[int]) -> Callable[[Drive, bytes, float], Treatment]:
    def treat(drive: Drive, frame: bytes, now: float) -> Treatment:
        is_kept = frame[1] in (6, 16) and int.from_bytes(frame[2:4], "big") in kept
        return Treatment(delay=_FLASH_TAKES) if is_kept else WELL

    return treat


_LATE_WHILE_MOVING = Option(
    "While it moves every seventh answer is 0.7 s late.",
    treats=_late_while_moving,
    spoils=True,
    bus={"late_reply_window": _LATE},  # by default a reply is late by 0.5 s at most
)
_BUSY = Option("To every seventh request it says that it is busy.", treats=_busy, spoils=True)
_SLOW = "It answers a write that it keeps in its flash 0.25 s late."

MKS = {
    "plain": PLAIN,
    "stuck-status": Option("0xF1 says for ever that it slows down.", {"stuck_status": Status.SLOWING_DOWN}),
    "settles-off": Option("It stands 0.3° off its target.", {"machine": {"following_error": 14}}, slack=14 / 16384),
    "starts-late": Option("It starts 30 ms after it was told to.", {"machine": {"start_delay": 0.03}}),
    "trip-latches": Option("After its watchdog stopped it, it wants to be enabled.", {"trip_latches": True}),
    "off-at-power-on": Option("It is not energised when it is switched on.", {"enabled_at_power_on": False}),
    "fed-by-all": Option(
        "Frames to others and broadcasts feed its watchdog, too.",
        {"fed_by": frozenset({"reads", "writes", "others", "broadcasts"})},
    ),
    "microsteps-8": Option(
        "Speeds count otherwise at 8 microsteps (7.1).", {"microsteps": 8}, {"microsteps": 8, "rpm": 300.0}
    ),
    "status-lies": Option("0xF1 says that it stands while it turns.", {"quirks": Quirks(lying=Status.STOPPED)}),
    "shaft-lags": Option("0xF1 says that it stands 50 ms before it does.", {"quirks": Quirks(lag=0.05)}),
    "status-undefined": Option(
        "Every third time 0xF1 says something that the manual does not name.", {"quirks": Quirks(undefined_every=3)}
    ),
    "refuses": Option("It refuses every seventh write.", {"quirks": Quirks(refuses_every=_EVERY)}, spoils=True),
    "late-while-moving": _LATE_WHILE_MOVING,
    "slow-flash": Option(_SLOW, treats=_slow_flash(_MKS_SETTINGS), spoils=True),
}
ZLAC = {
    "plain": PLAIN,
    "left-is-high": Option(
        "The left wheel is in the high half of 0x20A2.", {"status_word_left": "high"}, {"status_word_left": "high"}
    ),
    "ramps-for-the-range": Option(
        "Ramp times are for the whole range of speeds.", {"ramp_rpm": 1000.0}, {"ramp_rpm": 1000.0}
    ),
    "enable-forgets": Option("Enabling forgets the position it was going to.", {"enable_resumes": False}),
    "mode-releases": Option("A change of mode lets go of the wheels.", {"mode_change_releases": True}),
    "no-rpm-in-position-mode": Option("Speeds read 0 in position mode.", {"rpm_in_position_mode": False}),
    "trip-releases": Option("Its watchdog lets go of the wheels.", {"trip_state": ShaftState.RELEASED}),
    "watchdog-off": Option("It is shipped with its watchdog off.", {"watchdog": 0}),
    "settles-off": Option("A wheel stands 0.3° off its target.", {"following_error": 3}, slack=3 / 4096),
    "shaft-lags": Option("The status says that it stands 50 ms before it does.", {"status_lag": 0.05}),
    "late-while-moving": _LATE_WHILE_MOVING,
    "busy": _BUSY,
    "slow-flash": Option(_SLOW, treats=_slow_flash(zlac.SAVED), spoils=True),
}
TLR = {
    "plain": PLAIN,
    "triggers-by-write": Option(
        "Every write that has a bit set starts it.", {"trigger": "write"}, {"clear_trigger": False}
    ),
    "truncates": Option("It keeps four registers of a block.", {"truncates": 4}),
    "admits-truncation": Option(
        "It keeps four registers of a block, and says so.", {"truncates": 4, "admits_truncation": True}
    ),
    "ignores": Option("What it cannot do it acknowledges and ignores.", {"denies": False}),
    "uses-targets-up": Option("A trigger uses the target up.", {"keeps_target": False}, {"keeps_target": False}),
    "live-jog": Option("A jog under way takes a new speed.", {"live_jog": True}, {"live_jog": True}),
    "jog-by-level": Option("A jog ends when its bit is taken back.", {"jog_by_level": True}),
    "enabled-bit-lies": Option("Status bit 4 is always set.", {"enabled_bit": True}),
    "enabled-bit-never": Option("Status bit 4 is never set.", {"enabled_bit": False}),
    "settles-off": Option(
        "A closed loop stands 3 pulses off its target.", {"machine": {"following_error": 3}}, slack=3 / 4000
    ),
    "starts-late": Option("It starts 30 ms after it was told to.", {"machine": {"start_delay": 0.03}}),
    "stays-homed": Option("While it homes it says that it is homed.", {"machine": {"stays_homed": True}}),
    "open-loop": Option("It has no encoder.", {"operating_mode": OperatingMode.OPEN_LOOP}),
    "shaft-lags": Option("The status says that it stands 50 ms before it does.", {"status_lag": 0.05}),
    "unknown-bits": Option("Bits of the status are set that the manual does not name.", {"unknown_bits": 0xFF80}),
    "late-while-moving": _LATE_WHILE_MOVING,
    "busy": _BUSY,
    "slow-flash": Option(_SLOW, treats=_slow_flash(_TLR_SETTINGS), spoils=True),
}
OPTIONS: dict[str, dict[str, Option]] = {"mks": MKS, "zlac": ZLAC, "tlr": TLR}
