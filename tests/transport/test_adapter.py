"""A serial port that was lost is opened again on the same adapter only."""

import os
from pathlib import Path

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from rs485bus.errors import PortNotFound
from rs485bus.transport.adapter import adapter_at, find_again


def port(device: str, serial_number: str | None, location: str = "1-1", vid: int | None = 0x0403) -> ListPortInfo:
    info = ListPortInfo(device)
    info.vid, info.pid, info.serial_number, info.location, info.description = vid, 0x6001, serial_number, location, "FT"
    return info


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> list[ListPortInfo]:
    there: list[ListPortInfo] = []
    monkeypatch.setattr(list_ports, "comports", lambda: there)
    return there


def test_the_same_adapter_is_found_at_another_name(plugged: list[ListPortInfo]) -> None:
    plugged.append(port("/dev/ttyUSB0", "A1"))
    adapter = adapter_at("/dev/ttyUSB0")
    assert adapter is not None
    plugged[:] = [port("/dev/ttyUSB0", "B2"), port("/dev/ttyUSB1", "A1", "1-7")]
    assert find_again(adapter, "/dev/ttyUSB0") == "/dev/ttyUSB1"


def test_another_adapter_at_the_same_name_is_not_opened_and_both_are_named(plugged: list[ListPortInfo]) -> None:
    plugged.append(port("/dev/ttyUSB0", "A1"))
    adapter = adapter_at("/dev/ttyUSB0")
    assert adapter is not None
    plugged[:] = [port("/dev/ttyUSB0", "B2")]
    with pytest.raises(PortNotFound, match=r"another adapter now \(FT, serial number B2\).* opened on FT, .* A1"):
        find_again(adapter, "/dev/ttyUSB0")
    plugged.clear()
    with pytest.raises(PortNotFound, match="plug the same adapter in again"):
        find_again(adapter, "/dev/ttyUSB0")


def test_one_without_a_serial_number_is_known_by_its_usb_path(plugged: list[ListPortInfo]) -> None:
    plugged.append(port("/dev/ttyUSB0", None, "1-1"))
    adapter = adapter_at("/dev/ttyUSB0")
    assert adapter is not None
    plugged[:] = [port("/dev/ttyUSB0", None, "1-2")]
    with pytest.raises(PortNotFound, match="USB path 1-2"):
        find_again(adapter, "/dev/ttyUSB0")
    plugged[:] = [port("/dev/ttyUSB0", None, "1-2"), port("/dev/ttyUSB3", None, "1-1")]
    assert find_again(adapter, "/dev/ttyUSB0") == "/dev/ttyUSB3"


def test_adapters_that_all_bear_the_same_number_are_known_by_their_usb_path(plugged: list[ListPortInfo]) -> None:
    plugged[:] = [port("/dev/ttyUSB0", "0001", "1-1"), port("/dev/ttyUSB1", "0001", "1-2")]
    adapter = adapter_at("/dev/ttyUSB0")
    assert adapter is not None
    plugged.pop(0)
    with pytest.raises(PortNotFound):
        find_again(adapter, "/dev/ttyUSB0")
    plugged.append(port("/dev/ttyUSB0", "0001", "1-1"))
    assert find_again(adapter, "/dev/ttyUSB0") == "/dev/ttyUSB0"


def test_the_ports_of_one_adapter_are_not_taken_for_each_other(plugged: list[ListPortInfo]) -> None:
    plugged[:] = [port("/dev/ttyUSB0", "A1", "1-1:1.0"), port("/dev/ttyUSB1", "A1", "1-1:1.1")]
    second = adapter_at("/dev/ttyUSB1")
    assert second is not None
    plugged[:] = [port("/dev/ttyUSB4", "A1", "1-5:1.0"), port("/dev/ttyUSB5", "A1", "1-5:1.1")]
    assert find_again(second, "/dev/ttyUSB1") == "/dev/ttyUSB5"


def test_a_link_stays_the_way_to_the_port(plugged: list[ListPortInfo], tmp_path: Path) -> None:
    link = tmp_path / "axes"
    link.symlink_to("/dev/ttyUSB0")
    plugged.append(port("/dev/ttyUSB0", "A1"))
    adapter = adapter_at(os.fspath(link))
    assert adapter is not None
    assert find_again(adapter, os.fspath(link)) == os.fspath(link)


def test_a_built_in_port_is_no_adapter(plugged: list[ListPortInfo], monkeypatch: pytest.MonkeyPatch) -> None:
    plugged.append(port("/dev/ttyS0", None, "", None))
    assert adapter_at("/dev/ttyS0") is None
    assert adapter_at("/dev/ttyS1") is None

    def pulled_out() -> list[ListPortInfo]:
        raise TypeError("int() can't convert non-string with explicit base")

    monkeypatch.setattr(list_ports, "comports", pulled_out)
    assert adapter_at("/dev/ttyUSB0") is None
