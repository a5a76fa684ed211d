"""The fixtures that users of rs485bus test their machines with."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from rs485bus import MksServo, blocking, open_bus
from rs485bus.errors import DeviceRefused, NoReply
from rs485bus.pytest_plugin.clock import VirtualClock
from rs485bus.pytest_plugin.drives import VirtualDrives
from rs485bus.pytest_plugin.faults import LineFaults
from rs485bus.sim import VirtualLine


def test_a_machine_moves_in_virtual_time(
    virtual_clock: VirtualClock, virtual_line: VirtualLine, virtual_drives: VirtualDrives
) -> None:
    drive = virtual_drives.mks(1)

    async def machine() -> None:
        async with open_bus(virtual_line) as bus:
            x = MksServo(bus, 1)
            x.enable()
            await x.move_to(600, rpm=60)  # ten minutes

    begun = time.process_time()
    virtual_clock.run(machine())
    assert virtual_clock.time() > 1600
    assert time.process_time() - begun < 20
    assert drive.shaft(virtual_clock.time()) == pytest.approx(600, abs=0.01)
    assert virtual_drives.turning() == []


def test_a_blocking_script_sleeps_in_virtual_time(virtual_line: VirtualLine, virtual_drives: VirtualDrives) -> None:
    virtual_drives.mks(1)
    virtual_drives.zlac(3)
    with blocking.open_bus(virtual_line) as bus:
        x = bus.mks(1)
        x.enable().wait()
        x.run(60).wait()
        before = x.position()
        time.sleep(30)
        assert x.position() - before == pytest.approx(30, abs=0.5)
        assert virtual_drives.turning() == ["MKS 1"]
        x.stop().wait()
        assert virtual_drives.turning() == []


def test_a_line_is_opened_again_in_one_test(
    virtual_clock: VirtualClock, virtual_line: VirtualLine, virtual_drives: VirtualDrives
) -> None:
    """A program that is started anew finds the drives as it left them: for them, no time goes back."""
    virtual_drives.mks(1)

    async def machine(target: float) -> float:
        async with open_bus(virtual_line) as bus:
            x = MksServo(bus, 1)
            x.enable()
            return await x.move_to(target)

    for turns in (2, 4):
        with blocking.open_bus(virtual_line) as bus:
            x = bus.mks(1)
            x.enable().wait()
            assert x.move_to(turns - 1).wait() == turns - 1
            time.sleep(60)
            begun = virtual_clock.time()
        assert virtual_clock.run(machine(turns)) == turns
        assert virtual_clock.time() > begun


def test_faults_come_when_they_are_asked_for(
    virtual_line: VirtualLine, virtual_drives: VirtualDrives, line_faults: LineFaults
) -> None:
    unit = virtual_drives.unit(7, {0: 5})
    with blocking.open_bus(virtual_line) as bus:
        sensor = bus.unit(7)
        line_faults.lose_replies(7)
        line_faults.damage_replies(7)
        assert sensor.read_holding_registers(0, 1) == [5]
        assert bus.stats.units[7].retries == 2
        line_faults.refuse(7, 2)
        with pytest.raises(DeviceRefused):
            sensor.read_holding_registers(0, 1)
        wake = line_faults.silence(7)
        with pytest.raises(NoReply):
            sensor.read_holding_registers(0, 1)
        wake()
        time.sleep(3)
        assert sensor.read_holding_registers(0, 1) == [5]
        line_faults.unplug()
        time.sleep(0.1)
        assert not bus.connected
        line_faults.plug()
        time.sleep(10)
        assert bus.connected
    assert unit.address == 7


def test_two_devices_at_one_address_and_faults_of_none_are_refused(
    virtual_drives: VirtualDrives, line_faults: LineFaults
) -> None:
    virtual_drives.tlr(4)
    with pytest.raises(ValueError, match="already"):
        virtual_drives.mks(4)
    with pytest.raises(ValueError, match="no device at address 9"):
        line_faults.lose_requests(9)


OTHERS = """
import sys

def test_others():
    loaded = [name for name in sys.modules if name.startswith("rs485bus")]
    assert set(loaded) <= {"rs485bus", "rs485bus.pytest_plugin"}, loaded

def test_mine(virtual_clock, virtual_line, virtual_drives):
    virtual_drives.mks(1)
"""


def test_the_plugin_loads_nothing_of_the_bus_before_a_test_asks_for_a_fixture(tmp_path: Path) -> None:
    (tmp_path / "test_user.py").write_text(OTHERS)
    command = (sys.executable, "-m", "pytest", "-q", "-p", "rs485bus.pytest_plugin", str(tmp_path))
    root = Path(__file__).parent.parent.parent
    result = subprocess.run(
        (*command, "-c", "/dev/null", "--rootdir", str(tmp_path)),
        cwd=root,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "2 passed" in result.stdout
