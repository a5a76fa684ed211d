"""Scanning a pair, on the virtual clock: who is found, how quickly, and what is said of those that are garbled."""

import asyncio
import itertools

import pytest

from rs485bus.bench.first_file import first_plant_file
from rs485bus.bench.scan import ADDRESSES, RATES, Format, Found, Progress, Scan
from rs485bus.cli.find import parse_addresses
from rs485bus.devices import mks, tlr, zlac
from rs485bus.errors import PortError
from rs485bus.plant import PlantFile, families
from rs485bus.plant.building import try_out
from rs485bus.sim import Noise, SimDevice, SimMks, SimTlr, SimUnit, SimZlac, VirtualLine
from rs485bus.transport.interface import Transport
from rs485bus.wire.timing import LineSettings
from tests.integration.support import virtual


def scan(*devices: SimDevice, noise: Noise | None = None, **settings: object) -> Scan:
    def port(line: LineSettings) -> Transport:
        return VirtualLine(*devices, baudrate=line.baudrate, parity=line.parity, noise=noise or Noise())

    return Scan(port=port, **settings)  # type: ignore[arg-type]


def at(device: SimDevice, baudrate: int) -> SimDevice:
    device.baudrate = baudrate
    return device


class SlowUnit(SimUnit):
    turnaround = 0.05


def seen(found: list[Found]) -> list[tuple[int, str | None, int]]:
    return [(one.address, one.family, one.baudrate) for one in found]


@virtual
async def test_every_address_at_one_rate_takes_less_than_ten_seconds_and_each_family_is_known() -> None:
    began = asyncio.get_running_loop().time()
    found = await scan(SimMks(5), SimZlac(17), SimTlr(33), SimUnit(99, {7: 1}), SimMks(247), baudrates=[115200]).run()
    assert asyncio.get_running_loop().time() - began < 10
    assert [(one.address, one.family) for one in found] == [
        (5, "mks"),
        (17, "zlac"),
        (33, "tlr"),
        (99, None),
        (247, "mks"),
    ]
    assert not any(one.twins for one in found)
    assert [one.version for one in found] == ["109", "106", "102", None, "109"]


@virtual
async def test_drives_at_different_rates_are_found_at_theirs() -> None:
    drives = [at(SimMks(1), 38400), at(SimTlr(2), 115200), at(SimZlac(3), 9600)]
    found = await scan(*drives, addresses=range(1, 6)).run()
    assert seen(found) == [(3, "zlac", 9600), (1, "mks", 38400), (2, "tlr", 115200)]


@virtual
async def test_it_ends_as_soon_as_enough_is_found() -> None:
    it = scan(at(SimMks(1), 38400), at(SimMks(2), 9600), expect=1)
    began = asyncio.get_running_loop().time()
    assert seen(await it.run()) == [(1, "mks", 38400)]
    assert asyncio.get_running_loop().time() - began < 0.5


@pytest.mark.parametrize("make", [SimMks, SimTlr, SimZlac])
@virtual
async def test_two_drives_at_one_address_are_suspected(make: type[SimDevice]) -> None:
    found = await scan(make(7), make(7), SimMks(9), baudrates=[115200], addresses=range(1, 20)).run()
    assert [(one.address, one.twins) for one in found] == [(7, True), (9, False)]
    assert "two drives have address 7" in found[0].note


@virtual
async def test_a_device_that_answers_later_than_it_is_waited_for_is_found_all_the_same() -> None:
    found = await scan(SlowUnit(40, {1: 1}), SimMks(50), baudrates=[115200], addresses=range(30, 60)).run()
    assert [(one.address, one.family) for one in found] == [(40, None), (50, "mks")]
    assert found[0].reply_ms == pytest.approx(50, abs=1)


@virtual
async def test_a_noisy_pair_does_not_make_it_endless_nor_find_who_is_not_there() -> None:
    noise = Noise(stray=0.3, flipped=0.05)
    began = asyncio.get_running_loop().time()
    found = await scan(SimMks(5), SimTlr(6), noise=noise, baudrates=[115200], addresses=range(1, 60)).run()
    assert [one.address for one in found] == [5, 6]
    assert asyncio.get_running_loop().time() - began < 10


@virtual
async def test_only_reads_are_sent() -> None:
    device = SimUnit(3, dict.fromkeys(range(0x3000), 0))
    await scan(device, baudrates=[115200], addresses=[3]).run()
    assert device.writes == []


@virtual
async def test_line_settings_that_the_port_does_not_do_are_left_out_and_told() -> None:
    def port(line: LineSettings) -> Transport:
        if line.baudrate == 256000:
            raise PortError("the adapter does not do 256000 bit/s")
        return VirtualLine(SimMks(1), baudrate=line.baudrate)

    it = Scan(port=port, baudrates=[256000, 9600], addresses=[1])
    assert seen(await it.run()) == [(1, "mks", 9600)]
    assert it.skipped == ["256000 bit/s, 8N1: the adapter does not do 256000 bit/s"]
    with pytest.raises(PortError):
        await Scan(port=port, baudrates=[256000], addresses=[1]).run()


@virtual
async def test_progress_tells_how_long_it_will_take() -> None:
    told: list[float] = []
    it = scan(SimMks(1), baudrates=[9600], tell=lambda now: told.append(now.seconds + (now.left or 0.0)))
    loop = asyncio.get_running_loop()
    began = loop.time()
    await it.run()
    took = loop.time() - began
    assert told[150] == pytest.approx(took, rel=0.1)


@virtual
async def test_the_first_plant_file_of_what_was_found_is_right() -> None:
    found = await scan(SimMks(1), SimTlr(2), SimZlac(3), baudrates=[115200], addresses=range(1, 5)).run()
    other = Found(address=9, family="mks", title="MKS SERVO", baudrate=38400, format=Format("N", 1))
    text = first_plant_file("/dev/ttyUSB0", [*found, other])
    file = PlantFile.loads(text)
    assert list(file.axes) == ["mks1", "tlr2", "zlac3_left", "zlac3_right"]
    assert "# MKS SERVO 9 is at 38400 bit/s, 8N1" in text
    await asyncio.get_running_loop().run_in_executor(None, try_out, file)


def test_what_the_families_say_of_their_rates_is_what_their_registers_say() -> None:
    codes = {"mks": mks.values.BaudRate, "tlr": tlr.values.BaudRate, "zlac": zlac.values.BaudRate}
    for name, rates in codes.items():
        assert sorted(families()[name].baudrates) == sorted(int(rate.name.removeprefix("BAUD_")) for rate in rates)
    known = set(itertools.chain.from_iterable(family.baudrates for family in families().values()))
    assert known - set(RATES) == {25000}  # which few adapters can do


def test_addresses_are_read_as_people_write_them() -> None:
    assert parse_addresses("1-3, 7") == [1, 2, 3, 7]
    assert parse_addresses("1-247") == list(ADDRESSES)
    for wrong in ("", "a", "0", "240-250", "5-1", "1-"):
        with pytest.raises(ValueError, match="addresses"):
            parse_addresses(wrong)


@virtual
async def test_drives_as_shipped_are_found_at_once_whatever_their_rate() -> None:
    when: list[float] = []
    loop = asyncio.get_running_loop()
    began = loop.time()

    def tell(progress: Progress) -> None:
        while len(when) < len(progress.found):
            when.append(loop.time() - began)

    found = await scan(
        at(SimMks(1), 128000), at(SimMks(200), 128000), baudrates=RATES[:3] + RATES[-1:], tell=tell
    ).run()
    assert seen(found) == [(1, "mks", 128000), (200, "mks", 128000)]
    assert when[0] < 5  # long before all addresses were asked at the first rate
    assert when[1] < when[0] + 10  # where somebody is, others are looked for first
