"""`rs485bus setup`: one new drive after another, with a question before each change."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from rs485bus.bench.scan import ADDRESSES, RATES, Found, PortOf, Scan
from rs485bus.bench.setup import NewDrive, modbus_on
from rs485bus.cli.find import NOTHING, say_progress
from rs485bus.cli.process import DONE, FAILED, Output, WrongUse, agrees, ask_number, console
from rs485bus.devices.mks.provisioning import SHIPPED, Place, Provisioned
from rs485bus.plant.families import families
from rs485bus.sim import SimDevice, VirtualLine

_NEW = range(1, 16)
"""Addresses at which a new drive is looked for."""


@dataclass(kw_only=True)
class SetUp:
    """What is to be done, as the options say."""

    port: str | None
    address: int | None
    baudrate: int | None
    new_address: int | None
    new_baudrate: int | None
    modbus_on: bool
    yes: bool
    sim: bool
    out: Output = field(default_factory=console)
    drive: SimDevice | None = None
    """The virtual drive."""

    def check(self) -> None:
        """Refuse what cannot be meant. Raises `WrongUse`."""
        if self.port is None and not self.sim:
            raise WrongUse("Say which port: rs485bus setup /dev/ttyUSB0. rs485bus ports lists them.")
        if self.yes and self.new_address is None and self.new_baudrate is None:
            raise WrongUse("With --yes nobody is asked: say --new-address, --new-baudrate, or both.")

    async def run(self) -> int:
        """Set one drive up. Returns the exit code: 1 where a change was not confirmed."""
        try:
            return await self._run()
        except asyncio.CancelledError as cancelled:
            cancelled.add_note("Interrupted. No more was changed than is said here.")
            raise

    # Inside

    async def _run(self) -> int:
        if self.sim and self.port is None:
            simulate = families()["mks"].simulate
            assert simulate is not None
            self.drive = simulate(1, {})
            self.drive.baudrate = SHIPPED
        where = self.port or "the virtual pair"
        if not self._agrees(f"Is the drive alone on {where}, and does its motor stand?", "Only one may be there."):
            return FAILED
        if self.modbus_on and not await self._turn_modbus_on():
            return FAILED
        found = await self._look()
        if found is None:
            return FAILED
        drive = NewDrive.of(self._port(), found)
        self.out.print(f"Found: {found.title}, {drive.place}.")
        new = self._wanted(drive)
        drive.check(new)
        return DONE if await self._change(drive, new) else FAILED

    def _port(self) -> PortOf:
        if self.drive is not None:
            drive = self.drive
            return lambda line: VirtualLine(drive, baudrate=line.baudrate, parity=line.parity)
        assert self.port is not None
        return self.port

    async def _turn_modbus_on(self) -> bool:
        result = await modbus_on(self._port(), self.address or 1, self.baudrate or SHIPPED)
        self._say(result)
        return result.confirmed

    async def _look(self) -> Found | None:
        """The one drive that is there."""
        scan = Scan(
            port=self._port(),
            baudrates=RATES if self.baudrate is None else [self.baudrate],
            addresses=_NEW if self.address is None else [self.address],
            expect=2,
        )
        await say_progress(scan, self.out)
        if not scan.found and self.address is None:
            self.out.print(f"Nobody answers at addresses {_NEW.start} to {_NEW.stop - 1}. All others are tried now.")
            scan.addresses = range(_NEW.stop, ADDRESSES.stop)
            await say_progress(scan, self.out)
        if len(scan.found) == 1 and not scan.found[0].twins:
            return scan.found[0]
        if scan.found:
            there = ", ".join(f"{one.title} {one.address} at {one.baudrate} bit/s" for one in scan.found)
            self.out.print(
                f"There is more than one drive: {there}. Take all but one off the pair, or name it with --address and "
                "--baudrate if they differ.",
            )
            return None
        self.out.print(NOTHING)
        self.out.print("An MKS drive that does not speak Modbus yet is made to by --modbus-on.")
        return None

    def _wanted(self, drive: NewDrive) -> Place:
        address, baudrate = self.new_address, self.new_baudrate
        if not self.yes and address is None:
            address = ask_number("Which address is it to have", drive.address, drive.check_address)
        if not self.yes and baudrate is None:
            usual = max(rate for rate in families()[drive.family].baudrates if rate <= 115200)
            baudrate = ask_number("Which baud rate", usual, drive.check_baudrate)
        return Place(address or drive.address, baudrate or drive.baudrate)

    async def _change(self, drive: NewDrive, new: Place) -> bool:
        for what, wanted, present in (
            ("address", new.address, drive.address),
            ("baud rate", new.baudrate, drive.baudrate),
        ):
            if wanted == present:
                continue
            if not self._agrees(f"Change its {what} from {present} to {wanted}?", "It was left as it is."):
                return False
            change = drive.set_address if what == "address" else drive.set_baudrate
            result = await change(wanted, self._power_cycle)
            self._say(result)
            if not result.confirmed or result.place is None:
                return False
            drive = drive.at(result.place)
        self.out.print(f"Done: {drive.place}. Write it on the drive.")
        return True

    async def _power_cycle(self, text: str) -> bool:
        cycle = getattr(self.drive, "power_cycle", None)
        if cycle is not None:
            cycle(asyncio.get_running_loop().time())
            return True
        if self.yes:
            self.out.print(text)
            return False
        return agrees(f"{text} Is that done?")

    def _say(self, result: Provisioned) -> None:
        self.out.print(str(result))

    def _agrees(self, question: str, otherwise: str) -> bool:
        if self.yes or agrees(question):
            return True
        self.out.print(f"{otherwise} Nothing more was changed.")
        return False
