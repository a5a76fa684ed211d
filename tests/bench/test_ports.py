"""What is said of the serial ports of a machine."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from rs485bus.bench import ports
from rs485bus.cli.find import show_ports


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """One adapter, one port of the board that may or may not be there."""
    device = tmp_path / "ttyUSB0"
    device.touch()
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    (by_id / "usb-FTDI_A10").symlink_to(device)
    timer = tmp_path / "sys" / "ttyUSB0" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n")
    adapter = SimpleNamespace(device=str(device), vid=0x0403, description="FT232R", serial_number="A10")
    bare = SimpleNamespace(device="/dev/ttyS0", vid=None, description="n/a", serial_number=None)
    monkeypatch.setattr(ports, "plugged_in", lambda: [adapter, bare])
    monkeypatch.setattr(ports, "others", lambda path: ["cat (process 123)"])
    monkeypatch.setattr(ports, "_BY_ID", by_id)
    monkeypatch.setattr(ports, "_TTY", tmp_path / "sys")
    return tmp_path


def test_a_port_is_told_with_its_lasting_name_its_holder_and_its_latency(machine: Path) -> None:
    (port,) = ports.serial_ports()
    assert port.by_id == str(machine / "by-id" / "usb-FTDI_A10")
    assert port.held_by == ("cat (process 123)",)
    assert port.latency_ms == 16
    assert "close the other program" in " ".join(port.advice)
    assert f"echo 1 | sudo tee {machine}/sys/ttyUSB0/latency_timer" in " ".join(port.advice)


def test_a_port_that_this_user_may_not_open_names_the_group_to_join(
    machine: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ports.os, "access", lambda path, mode: False)
    show_ports(False)
    assert "sudo usermod -aG" in capsys.readouterr().out


def test_without_any_port_it_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ports, "plugged_in", list)
    show_ports(False)
    assert "rs485bus sim puts virtual drives" in " ".join(capsys.readouterr().out.split())
    show_ports(True)
    assert capsys.readouterr().out.strip() == "[]"
