"""The families that come with this package, for the plant file and the commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from rs485bus.plant.family import Family, Sign

if TYPE_CHECKING:
    from rs485bus.sim import SimDevice

_SWITCH = 2.0
"""Turns between where a virtual drive begins and its home switch."""


def _mks_facade() -> Callable[..., Any]:
    from rs485bus.devices.mks import MksServo

    return MksServo


def _zlac_facade() -> Callable[..., Any]:
    from rs485bus.devices.zlac import Zlac8015d

    return Zlac8015d


def _tlr_facade() -> Callable[..., Any]:
    from rs485bus.devices.tlr import TlrStepper

    return TlrStepper


def _virtual_mks(address: int, options: Mapping[str, Any]) -> SimDevice:
    from rs485bus.sim import Machine, SimMks

    return SimMks(address, machine=Machine(home_switch=-_SWITCH), **_some(options, "model", "mode", "microsteps"))


def _virtual_zlac(address: int, options: Mapping[str, Any]) -> SimDevice:
    from rs485bus.sim import SimZlac

    return SimZlac(
        address, lines=options.get("encoder_lines") or 1024, **_some(options, "status_word_left", "ramp_rpm")
    )


def _virtual_tlr(address: int, options: Mapping[str, Any]) -> SimDevice:
    from rs485bus.sim import SimTlr, TlrMachine

    # Homing as shipped goes up to the switch.
    return SimTlr(
        address,
        machine=TlrMachine(origin=(_SWITCH, _SWITCH + 0.1)),
        subdivision=options.get("pulses_per_turn") or 4000,
        **_some(options, "keeps_target", "live_jog", "ramp_rpm"),
    )


def _some(options: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: options[name] for name in names if name in options}


BUILTIN = (
    Family(
        name="mks",
        title="MKS SERVO",
        facade=_mks_facade,
        watchdog=(0.05, 4_294_967.0),
        baudrate=38400,
        baudrates=(9600, 19200, 25000, 38400, 57600, 115200, 256000),
        # The motor's status, its enabling, its stall: drives of the family read by function 04 only.
        signs=(Sign(4, 0xF1, high=6), Sign(4, 0x3A, high=1), Sign(4, 0x3E, high=1)),
        version=Sign(4, 0x40, count=2),
        simulate=_virtual_mks,
    ),
    Family(
        name="zlac",
        title="ZLAC8015D",
        facade=_zlac_facade,
        sides=("left", "right"),
        by_side=frozenset({"reverse"}),
        addresses=(1, 127),
        watchdog=(0.05, 32.767),
        baudrates=(9600, 19200, 38400, 57600, 115200, 128000),
        # Its own address, its baud rate's code, the watchdog's time.
        signs=(Sign(3, 0x2001, is_address=True), Sign(3, 0x2002, low=1, high=6)),
        version=Sign(3, 0x20A0),
        simulate=_virtual_zlac,
    ),
    Family(
        name="tlr",
        title="TL-R",
        facade=_tlr_facade,
        baudrates=(9600, 19200, 38400, 115200),
        # The pulses a turn, the baud rate's code, the direction.
        signs=(Sign(3, 0x23, low=400, high=51200), Sign(3, 0x28, high=3), Sign(3, 0x22, high=1)),
        version=Sign(3, 0x01),
        simulate=_virtual_tlr,
    ),
)
