"""Giving a new drive its address and its baud rate, whatever its family. One drive alone on the pair.

When such a change counts, the manuals do not say, or say differently: at once, or after the drive was switched off and
on. So it is looked for at the new place and at the old one, and what was not seen is not said.
"""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace

import anyio

from rs485bus.bench.scan import Format, Found, PortOf, open_line, port_for, recognise
from rs485bus.bus.bus import Bus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.opening import Opening
from rs485bus.devices import mks, tlr, zlac
from rs485bus.devices.mks import provisioning
from rs485bus.devices.mks.provisioning import Place, Provisioned
from rs485bus.errors import AddressInUse, NoReply, NotStanding, NotSupported, OutcomeUnknown, RequestFailed
from rs485bus.plant.families import families
from rs485bus.transport.interface import Transport
from rs485bus.wire.frames import read_holding
from rs485bus.wire.timing import LineSettings

PowerCycle = Callable[[str], Awaitable[bool]]
"""Asks somebody to switch the drive off and on. Returns whether that was done."""


_USUAL = Format("N", 1)
_SETTLES = 0.5
_COMES_BACK = 20
"""Times half a second that a drive may take to answer after it was switched on."""
_DIP_STATIONS = 15
_PATIENT = BusConfig(offline_after=100, late_reply_window=0.1)


async def by_nobody(text: str) -> bool:
    """Nobody is there who could switch the drive off and on."""
    return False


@dataclass(frozen=True, slots=True, kw_only=True)
class NewDrive:
    """A drive alone on its pair."""

    port: PortOf
    family: str
    address: int
    baudrate: int
    format: Format = _USUAL

    @classmethod
    def of(cls, port: PortOf, found: Found) -> NewDrive:
        """What a scan has found. Raises `NotSupported` for what is of no known family."""
        if found.family not in ("mks", "tlr", "zlac"):
            raise NotSupported(
                f"What answers at address {found.address} is no drive that can be set up here ({found.title}). "
                "rs485bus write writes any register: its manual tells which one holds the address."
            )
        return cls(port=port, family=found.family, address=found.address, baudrate=found.baudrate, format=found.format)

    @property
    def place(self) -> Place:
        """Where it answers."""
        return Place(self.address, self.baudrate)

    def at(self, place: Place) -> NewDrive:
        """The same drive where it answers now."""
        return replace(self, address=place.address, baudrate=place.baudrate)

    def check(self, new: Place) -> None:
        """Refuse a place that it cannot have. Raises `NotSupported`."""
        self.check_address(new.address)
        self.check_baudrate(new.baudrate)

    def check_address(self, address: int) -> None:
        """Refuse an address that it cannot have. Raises `NotSupported`."""
        family = families()[self.family]
        low, high = family.addresses
        if not low <= address <= high:
            raise NotSupported(f"{family.title} drives have addresses {low}..{high}, not {address}.")

    def check_baudrate(self, baudrate: int) -> None:
        """Refuse a baud rate that it cannot have. Raises `NotSupported`."""
        family = families()[self.family]
        if baudrate not in family.baudrates:
            raise NotSupported(
                f"{family.title} drives have {', '.join(map(str, family.baudrates))} bit/s, not {baudrate}."
            )

    async def set_address(self, new: int, power_cycle: PowerCycle = by_nobody) -> Provisioned:
        """Give it another address.

        Raises:
            NotSupported: it cannot have that one.
            AddressInUse: somebody answers there already.
            NoReply: nobody answers at its own.
            NotStanding: its motor turns.
            DeviceRefused: it said no.
        """
        self.check(Place(new, self.baudrate))
        if self.family == "mks":
            return await provisioning.set_address(self._at, new, address=self.address, baudrate=self.baudrate)
        return await self._change(Place(new, self.baudrate), power_cycle)

    async def set_baudrate(self, new: int, power_cycle: PowerCycle = by_nobody) -> Provisioned:
        """Give it another baud rate. Raises as `set_address`."""
        self.check(Place(self.address, new))
        if self.family == "mks":
            code = next(code for code in mks.BaudRate if code.baudrate == new)
            return await provisioning.set_baud_rate(self._at, code, address=self.address, baudrate=self.baudrate)
        return await self._change(Place(self.address, new), power_cycle)

    # Inside

    def _at(self, baudrate: int) -> str | Transport:
        return port_for(self.port, self._line(baudrate))

    def _line(self, baudrate: int) -> LineSettings:
        return LineSettings(baudrate=baudrate, parity=self.format.parity, stopbits=self.format.stopbits)

    def _open(self, baudrate: int) -> Opening:
        return open_line(self.port, self._line(baudrate), _PATIENT)

    async def _change(self, new: Place, power_cycle: PowerCycle) -> Provisioned:
        old = self.place
        async with self._open(old.baudrate) as bus:
            if not await self._answers(bus, old.address):
                raise NoReply(f"Nobody answers: {old}. Check power, wires, address and baud rate.")
            if new.address != old.address and await self._is_taken(bus, new.address):
                raise AddressInUse(
                    f"Somebody answers at address {new.address} already. Only one drive may be on the pair for this."
                )
            with provisioning.said_where(old, new):
                await self._write(bus, new)
        with provisioning.said_where(old, new):
            await anyio.sleep(_SETTLES)
            found = await self._find(new, old)
            if found is not None and self.family == "tlr":
                await self._save(found)
        if found == new:
            return Provisioned(True, new, f"It answers: {new}.")
        if not await power_cycle("Switch the drive off and on: it takes the change then."):
            return Provisioned(False, found, "it was told, and takes it when it is switched off and on. Look then.")
        for _ in range(_COMES_BACK):
            await anyio.sleep(_SETTLES)
            found = await self._find(new, old)
            if found is not None:
                break
        if found == new:
            return Provisioned(True, new, f"It answers: {new}.")
        if found is None:
            return Provisioned(False, None, f"it answers neither {old} nor {new}. Look for it: rs485bus scan.")
        return Provisioned(False, found, f"it still answers: {old}. {self._why_not(new)}")

    async def _answers(self, bus: Bus, address: int) -> bool:
        found = await recognise(bus, address, self.baudrate, self.format)
        return found.reply_ms is not None

    async def _is_taken(self, bus: Bus, address: int) -> bool:
        return await self._answers(bus, address) or await provisioning.somebody_answers(
            bus, read_holding(address, 0, 1)
        )

    async def _find(self, *places: Place) -> Place | None:
        for place in places:
            async with self._open(place.baudrate) as bus:
                if await self._answers(bus, place.address):
                    return place
        return None

    async def _write(self, bus: Bus, new: Place) -> None:
        """Tell it. It may answer at the new place already, which is not heard here."""
        moved = new.address != self.address
        try:
            if self.family == "zlac":
                drive = zlac.Zlac8015d(bus, self.address)
                if await drive.left.velocity() or await drive.right.velocity():
                    raise NotStanding(f"{drive.name} turns. Stop it before its drive goes elsewhere.")
                r = zlac.registers
                if moved:
                    await bus.unit(self.address).write(r.NODE_ID, new.address)
                else:
                    await bus.unit(self.address).write(r.BAUD_RATE, zlac.values.BaudRate[f"BAUD_{new.baudrate}"])
                return
            stepper = tlr.TlrStepper(bus, self.address)
            if await stepper.velocity():
                raise NotStanding(f"{stepper.name} turns. Stop it before its drive goes elsewhere.")
            if moved:
                await stepper.set_station(new.address)
            else:
                await stepper.set_baudrate(tlr.BaudRate[f"BAUD_{new.baudrate}"])
        except (NoReply, OutcomeUnknown):
            return

    async def _save(self, found: Place) -> None:
        """Have a TL-R keep it: without, it is forgotten when it is switched off. What comes of that is seen then."""
        async with self._open(found.baudrate) as bus:
            with contextlib.suppress(RequestFailed):
                await tlr.TlrStepper(bus, found.address).save()

    def _why_not(self, new: Place) -> str:
        if self.family != "tlr":
            return "Repeat it; if it stays so, its manual tells what else keeps its address and rate."
        if new.baudrate != self.baudrate:
            return "Its switch SW5 must be on for any other rate than 115200: set it, and switch it off and on."
        if new.address <= _DIP_STATIONS:
            switches = ", ".join(f"SW{bit + 1} {'on' if new.address >> bit & 1 else 'off'}" for bit in range(4))
            return f"Its switches make its address. For {new.address}: {switches}; then switch it off and on."
        return "Its switches make its address: SW1 to SW4 must all be off for any above 15; then switch it off and on."


async def modbus_on(port: PortOf, address: int, baudrate: int) -> Provisioned:
    """Have an MKS drive speak Modbus that is set to its own protocol."""
    line = LineSettings(baudrate=baudrate)
    return await provisioning.enable_modbus(
        lambda rate: port_for(port, replace(line, baudrate=rate)), address=address, baudrate=baudrate
    )
