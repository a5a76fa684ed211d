"""Setting a new drive up, on the virtual clock: each family, whenever its change counts, and what keeps it from it."""

import asyncio
from typing import Any

import pytest

from rs485bus.bench.scan import Format, Found, Scan
from rs485bus.bench.setup import NewDrive, modbus_on
from rs485bus.errors import AddressInUse, NoReply, NotStanding, NotSupported
from rs485bus.sim import Dip, SimDevice, SimMks, SimTlr, SimUnit, SimZlac, VirtualLine
from rs485bus.transport.interface import Transport
from rs485bus.wire.timing import LineSettings
from tests.integration.support import virtual


def rate(drive: SimDevice, baudrate: int) -> SimDevice:
    drive.baudrate = baudrate
    return drive


class Bench:
    """One drive on a pair, and somebody who switches it off and on."""

    def __init__(self, family: str, drive: Any, *others: SimDevice, baudrate: int = 115200) -> None:
        self.sim = drive
        self.others = others
        self.asked: list[str] = []
        self.drive = NewDrive(port=self.port, family=family, address=drive.address, baudrate=baudrate)

    def port(self, line: LineSettings) -> Transport:
        return VirtualLine(self.sim, *self.others, baudrate=line.baudrate)

    async def cycle(self, text: str) -> bool:
        self.asked.append(text)
        self.sim.power_cycle(asyncio.get_running_loop().time())
        return True


async def not_now(text: str) -> bool:
    return False


CUSTOM = Dip(0, custom_baudrate=True)


@pytest.mark.parametrize(
    ("family", "make", "baudrate", "cycles"),
    [
        ("mks", lambda: SimMks(1, baudrate=38400), 38400, 0),
        ("mks", lambda: SimMks(1, baudrate=38400, answers_at_new=True), 38400, 0),
        ("zlac", lambda: rate(SimZlac(1), 115200), 115200, 2),
        ("tlr", lambda: SimTlr(20, dip=CUSTOM), 115200, 2),
        ("tlr", lambda: SimTlr(20, dip=CUSTOM, serial_at_once=True), 115200, 0),
    ],
)
@virtual
async def test_each_family_gets_its_address_and_its_rate(family: str, make: Any, baudrate: int, cycles: int) -> None:
    bench = Bench(family, make(), baudrate=baudrate)
    moved = await bench.drive.set_address(7, bench.cycle)
    assert moved.confirmed, moved
    bench.drive = NewDrive(port=bench.port, family=family, address=7, baudrate=baudrate)
    changed = await bench.drive.set_baudrate(19200, bench.cycle)
    assert changed.confirmed, changed
    assert (bench.sim.address, bench.sim.baudrate) == (7, 19200)
    assert len(bench.asked) == cycles
    if hasattr(bench.sim, "power_cycle"):
        await bench.cycle("")  # it keeps it
        assert (bench.sim.address, bench.sim.baudrate) == (7, 19200)


@virtual
async def test_switches_that_make_a_station_are_named_with_how_to_set_them() -> None:
    bench = Bench("tlr", SimTlr(1))
    result = await bench.drive.set_address(5, bench.cycle)
    assert not result.confirmed
    assert "SW1 on, SW2 off, SW3 on, SW4 off" in str(result)
    result = await bench.drive.set_address(20, bench.cycle)
    assert "SW1 to SW4 must all be off" in str(result)
    result = await bench.drive.set_baudrate(9600, bench.cycle)
    assert "SW5 must be on" in str(result)
    assert (bench.sim.address, bench.sim.baudrate) == (1, 115200)


@virtual
async def test_what_was_not_seen_is_not_said() -> None:
    bench = Bench("zlac", rate(SimZlac(1), 115200))
    result = await bench.drive.set_address(7, not_now)
    assert not result.confirmed
    assert "takes it when it is switched off and on" in str(result)


@virtual
async def test_an_address_that_is_taken_is_left_to_its_owner() -> None:
    bench = Bench("zlac", rate(SimZlac(1), 115200), rate(SimZlac(7), 115200))
    with pytest.raises(AddressInUse):
        await bench.drive.set_address(7, bench.cycle)
    assert bench.sim.address == 1


@virtual
async def test_a_drive_that_is_not_there_or_turns_is_told() -> None:
    bench = Bench("tlr", SimTlr(20, dip=CUSTOM))
    absent = NewDrive(port=bench.port, family="tlr", address=9, baudrate=115200)
    with pytest.raises(NoReply):
        await absent.set_address(7, bench.cycle)
    mks = Bench("mks", SimMks(1, baudrate=38400), baudrate=38400)
    from rs485bus import MksServo, open_bus

    line = mks.port(LineSettings(baudrate=38400))
    async with open_bus(line) as bus:
        servo = MksServo(bus, 1)
        servo.enable()
        await servo.run(60)
        await bus.aclose(leave_running=True)
    with pytest.raises(NotStanding):
        await mks.drive.set_address(7, mks.cycle)


@pytest.mark.parametrize(("address", "baudrate"), [(200, 115200), (5, 256000)])
@virtual
async def test_what_the_family_cannot_have_is_refused_before_anything_is_sent(address: int, baudrate: int) -> None:
    bench = Bench("zlac", rate(SimZlac(1), 115200))
    with pytest.raises(NotSupported, match="ZLAC8015D drives have"):
        await (
            bench.drive.set_address(address, not_now) if address == 200 else bench.drive.set_baudrate(baudrate, not_now)
        )


def test_a_device_of_no_known_family_is_not_set_up() -> None:
    found = Found(address=3, family=None, title="Modbus device", baudrate=9600, format=Format("N", 1))
    with pytest.raises(NotSupported, match="rs485bus write"):
        NewDrive.of(lambda line: VirtualLine(SimUnit(3, {})), found)


@virtual
async def test_an_mks_drive_that_speaks_its_own_protocol_is_made_to_speak_modbus() -> None:
    sim = SimMks(1, baudrate=38400)
    sim.settings[0x8E] = False
    bench = Bench("mks", sim, baudrate=38400)
    result = await modbus_on(bench.port, 1, 38400)
    assert result.confirmed, result


@virtual
async def test_a_port_is_said_by_its_name_and_a_drive_is_gone_on_with_where_it_answers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sim = SimMks(1, baudrate=38400)
    monkeypatch.setattr(
        "rs485bus.bus.opening.transport_at", lambda port, **line: lambda: VirtualLine(sim, baudrate=line["baudrate"])
    )
    (found,) = await Scan(port="/dev/ttyUSB0", expect=1).run()
    drive = NewDrive.of("/dev/ttyUSB0", found)
    moved = await drive.set_address(5)
    assert (moved.confirmed, moved.place) == (True, (5, 38400))
    assert moved.place is not None
    assert (await drive.at(moved.place).set_baudrate(115200)).place == (5, 115200)


@virtual
async def test_where_nobody_can_switch_the_drive_off_it_is_said_to_take_the_change_then() -> None:
    bench = Bench("zlac", rate(SimZlac(1), 115200))
    told = await bench.drive.set_address(7)
    assert not told.confirmed
    assert "takes it when it is switched off and on" in str(told)


@pytest.mark.parametrize(
    ("family", "make", "baudrate"),
    [
        ("mks", lambda: SimMks(1, baudrate=38400), 38400),
        ("zlac", lambda: rate(SimZlac(1), 115200), 115200),
        ("tlr", lambda: SimTlr(20, dip=CUSTOM, serial_at_once=True), 115200),
    ],
)
@virtual
async def test_who_is_interrupted_is_told_where_the_drive_may_be_once_it_may_have_been_told(
    family: str, make: Any, baudrate: int
) -> None:
    ends: list[bool] = []
    for hundredths in range(0, 400, 2):
        bench = Bench(family, make(), baudrate=baudrate)
        told = [False]
        answer = bench.sim.answer

        def hear(pdu: bytes, now: float, *, broadcast: bool, told: Any = told, answer: Any = answer) -> Any:
            told[0] = told[0] or (pdu[0] in (6, 16) and pdu[-1] == 7)
            return answer(pdu, now, broadcast=broadcast)

        bench.sim.answer = hear
        change = asyncio.create_task(bench.drive.set_address(7))
        await asyncio.sleep(hundredths / 100)
        change.cancel()
        try:
            await change
        except asyncio.CancelledError as cancelled:
            notes = " ".join(getattr(cancelled, "__notes__", ()))
            ends.append(told[0])
            assert not told[0] or f"{bench.drive.place}, or address 7 at {baudrate} bit/s. Look at both." in notes
    assert set(ends) == {False, True}
