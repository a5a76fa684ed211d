"""Readings of the manuals and quirks of drives that every scenario is run with."""

from __future__ import annotations

from rs485bus.devices.mks import Status
from rs485bus.sim.campaigns.faults.plant import Option

PLAIN = Option("As the manual reads at first sight.")

OPTIONS: dict[str, dict[str, Option]] = {
    "mks": {
        "plain": PLAIN,
        "stuck-status": Option("0xF1 says for ever that it slows down.", {"stuck_status": Status.SLOWING_DOWN}),
        "settles-off": Option("It stands 0.3° off its target.", {"machine": {"following_error": 14}}, slack=14 / 16384),
    },
    "zlac": {"plain": PLAIN},
    "tlr": {"plain": PLAIN},
}
