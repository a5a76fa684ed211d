"""Provisioning: a new address, a new baud rate, Modbus on and off. Source: MKS RTU V1.0.9, 3.2.10 to 3.2.12.

**One drive alone on the pair.** Each function opens the port itself, at the rate at which the drive listens, and ends
what a bus that is open could say to it. Whether a drive answers such a change at the old or at the new setting the
manual does not say, so both are looked at. What could not be confirmed says so, and is no error.

    print(await set_address("/dev/ttyUSB0", 5))
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.opening import Opening, open_bus
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import native, read, write
from rs485bus.devices.mks.values import BaudRate, Status
from rs485bus.errors import AddressInUse, DeviceRefused, NoReply, NotStanding
from rs485bus.transport.interface import Transport
from rs485bus.wire.frames import Request, payload
from rs485bus.wire.registers import Repeat

Port = str | Callable[[int], str | Transport]
"""A port, as for `open_bus`; or what makes one for a baud rate."""

SHIPPED = 38400
"""bit/s (2.2); at address 1 (2.3)."""
_SETTLES = 0.5
_ATTEMPTS = 3
_PATIENT = BusConfig(offline_after=100)


class Place(NamedTuple):
    """Where a drive answers."""

    address: int
    baudrate: int

    def __str__(self) -> str:
        return f"address {self.address} at {self.baudrate} bit/s"


@dataclass(frozen=True, slots=True)
class Provisioned:
    """What came of it."""

    confirmed: bool
    """It was seen that the drive has the new setting."""
    place: Place | None
    """Where it answers Modbus now, if it does."""
    message: str
    """What is known, and what to do next."""

    def __str__(self) -> str:
        return f"{'Confirmed' if self.confirmed else 'NOT CONFIRMED'}: {self.message}"


async def set_address(port: Port, new: int, *, address: int = 1, baudrate: int = SHIPPED) -> Provisioned:
    """Give the drive at `address` a new one (3.2.11).

    Args:
        port: where the drive is, alone.
        new: 1..247. The manual allows 0 to 255; 0 is everybody's, and Modbus ends at 247.
        address: the present one.
        baudrate: bit/s.

    Raises:
        LimitExceeded: out of range; nothing was sent.
        AddressInUse: somebody answers at the new address already: the drive is not alone.
        NoReply: nobody answers at the present address, nor at the new one.
        NotStanding: its motor turns.
        DeviceRefused: it said no.
    """
    return await _change(port, write(address, r.ADDRESS, new), Place(address, baudrate), Place(new, baudrate))


async def set_baud_rate(port: Port, new: BaudRate, *, address: int = 1, baudrate: int = SHIPPED) -> Provisioned:
    """Give the drive at `address` a new baud rate (3.2.10). Arguments and errors as for `set_address`.

    Code 3 is 25000 bit/s in the manual, which few adapters can do.
    """
    return await _change(port, write(address, r.BAUD_RATE, new), Place(address, baudrate), Place(address, new.baudrate))


async def enable_modbus(port: Port, *, address: int = 1, baudrate: int = SHIPPED) -> Provisioned:
    """Have a drive speak Modbus that was set to its native protocol (3.2.12).

    The manual prints the frame for address 1; for others it is inferred.
    """
    place = Place(address, baudrate)
    async with _open(port, baudrate) as bus:
        if await _answers(bus, address):
            return Provisioned(True, place, f"It speaks Modbus already: {place}.")
        for _ in range(_ATTEMPTS):
            await bus.ask(native(address, r.MODBUS.address, 1), repeat=Repeat.NEVER)
            await anyio.sleep(_SETTLES)
            if await _answers(bus, address):
                return Provisioned(True, place, f"It speaks Modbus: {place}.")
    return Provisioned(
        False,
        None,
        f"nobody answers Modbus: {place}. Check power, wires, address and baud rate, and look at MB_RTU in its menu.",
    )


async def disable_modbus(port: Port, *, address: int = 1, baudrate: int = SHIPPED) -> Provisioned:
    """Set the drive at `address` to its native protocol, which this package does not speak (3.2.12).

    Raises `NoReply`, `NotStanding` and `DeviceRefused` as `set_address` does.
    """
    place = Place(address, baudrate)
    async with _open(port, baudrate) as bus:
        if not await _answers(bus, address):
            raise NoReply(f"Nobody answers: {place}. Check power, wires, address and baud rate.")
        await _check_standing(bus, address)
        acknowledged = await _acknowledges(bus, write(address, r.MODBUS, False))
        await anyio.sleep(_SETTLES)
        if await _answers(bus, address):
            return Provisioned(False, place, f"it still answers Modbus: {place}. Switch it off and on, and look again.")
    if acknowledged:
        return Provisioned(True, None, "It acknowledged, and answers no Modbus any more. `enable_modbus` undoes it.")
    return Provisioned(
        False,
        None,
        "it did not acknowledge, and does not answer: it may be off Modbus, or away. `enable_modbus` tells.",
    )


@contextmanager
def said_where(old: Place, new: Place) -> Iterator[None]:
    """Whatever ends this before its time, a cancellation included, carries a note of where the drive may be then."""
    try:
        yield
    except DeviceRefused:
        raise
    except BaseException as error:
        error.add_note(
            f"The drive may have been told already, and was not looked for since: {old}, or {new}. Look at both."
        )
        raise


async def _change(port: Port, request: Request, old: Place, new: Place) -> Provisioned:
    async with _open(port, old.baudrate) as bus:
        here = await _answers(bus, old.address)
        if here and new.address != old.address and await _answers(bus, new.address):
            raise AddressInUse(
                f"Somebody answers at address {new.address} already. Only one drive may be on the pair for this."
            )
        if here:
            await _check_standing(bus, old.address)
            with said_where(old, new):
                acknowledged = await _acknowledges(bus, request)
    if not here:
        if await _find(port, new) is None:
            raise NoReply(f"Nobody answers: neither {old} nor {new}. Check power, wires, address and baud rate.")
        return Provisioned(True, new, f"It had the new setting already: {new}.")
    with said_where(old, new):
        await anyio.sleep(_SETTLES)
        found = await _find(port, new, old)
    if found == new:
        return Provisioned(True, new, f"It answers: {new}.")
    took = "acknowledged the change" if acknowledged else "did not acknowledge the change"
    if found is None:
        message = f"it {took} and answers neither {old} nor {new}. Switch it off and on, and look at both."
    else:
        message = f"it {took} and still answers: {old}. Switch it off and on, look at both, and repeat it if need be."
    return Provisioned(False, found, message)


def _open(port: Port, baudrate: int) -> Opening:
    return open_bus(port if isinstance(port, str) else port(baudrate), baudrate=baudrate, config=_PATIENT)


async def _find(port: Port, *places: Place) -> Place | None:
    for place in places:
        async with _open(port, place.baudrate) as bus:
            if await _answers(bus, place.address):
                return place
    return None


async def _answers(bus: Bus, address: int) -> bool:
    """Whether somebody is there."""
    return await somebody_answers(bus, read(address, r.STATUS))


async def somebody_answers(bus: Bus, request: Request) -> bool:
    """Whether somebody answers a read. A refusal is an answer, too: of a drive of another family.

    Before nobody is said to be there, it is asked in several rounds, and with pauses in which late replies go by: where
    the line loses some, a second drive would be overlooked else, and both have one address then.
    """
    for turn in range(_ATTEMPTS):
        if turn:
            await anyio.sleep(_SETTLES)
        try:
            await bus.ask(request)
        except NoReply:
            continue
        except DeviceRefused:
            pass
        return True
    return False


async def _acknowledges(bus: Bus, request: Request) -> bool:
    """Send a change. An answer at the new setting is not heard here; it is looked for afterwards."""
    try:
        await bus.ask(request)
    except NoReply:
        return False
    return True


async def _check_standing(bus: Bus, address: int) -> None:
    status = r.STATUS.decode(payload(await bus.ask(read(address, r.STATUS))))
    speed = r.SPEED.decode(payload(await bus.ask(read(address, r.SPEED))))
    if status is not Status.STOPPED and speed != 0:
        raise NotStanding(f"The motor at address {address} turns. Stop it before its drive goes elsewhere.")
