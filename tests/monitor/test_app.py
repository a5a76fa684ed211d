"""The view itself, without a terminal: what it shows at 80x24 and at 120x40, and what its keys do."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import DataTable, Static

from rs485bus.bus.capture_lines import Exchange
from rs485bus.monitor.app import MonitorApp, _bus_line
from rs485bus.monitor.snapshot import AxisSight, BusSight, Snapshot
from rs485bus.wire.crc import crc


def frame(text: str) -> bytes:
    data = bytes.fromhex(text)
    return data + crc(data)


LATEST = (
    Exchange(1.0, 1.01, 1, frame("01 04 0031 0003"), frame("01 04 06 000000004000"), "reply", "poll"),
    Exchange(1.1, 1.2, 4, frame("04 03 0004 0007"), b"", "no reply", "poll"),
)
PAIR = BusSight("main", "/dev/ttyUSB0", 115200, True, 0.23, 120, 3, 0, 0.01, 0.004, LATEST, {1: "MKS", 4: "TL-R"})


def axis(name: str, state: str, **others: Any) -> AxisSight:
    known: dict[str, Any] = {"position": 1.5, "unit": "mm", "target": 2.0, "rpm": 60.0, "set_point": None}
    known |= {"margin": 0.7, "watchdog": 1.0, "notice": ""}
    return AxisSight(name=name, state=state, **{**known, **others})


class Buses:
    """Stands for the thread of the buses: says what it is told to, and notes what is asked."""

    def __init__(self) -> None:
        self.ended = False
        self.asked: list[str] = []
        self.stopped: list[str] = []

    def snapshot(self) -> Snapshot:
        axes = axis("x", "moving"), axis("y", "FAULT", notice="over current", margin=None, watchdog=None)
        return Snapshot(1.3, axes, (PAIR,))

    def tell(self, act: Callable[[Any], None]) -> None:
        act(self)

    def stop(self, name: str) -> None:
        self.asked.append(f"stop {name}")

    def stop_all(self) -> None:
        self.asked.append("stop all")

    def emergency_stop(self) -> None:
        self.asked.append("emergency stop")


async def until(pilot: Pilot[Any], seen: Callable[[], bool]) -> None:
    """Wait until it is seen: a busy machine takes its time. What is not seen then, the test says."""
    for _ in range(200):
        if seen():
            return
        await pilot.pause(0.05)


def shown(app: MonitorApp) -> dict[str, str]:
    return {name: str(app.query_one(f"#{name}", Static).render()) for name in ("buses", "frames", "notice")}


@pytest.mark.parametrize("size", [(80, 24), (120, 40)])
def test_it_shows_axes_bus_and_transactions_and_its_keys_stop_and_pause(size: tuple[int, int]) -> None:
    async def main() -> None:
        buses = Buses()
        app = MonitorApp(buses, "cell")  # type: ignore[arg-type] # it says what a thread of buses would
        async with app.run_test(size=size) as pilot:
            table = app.query_one(DataTable)
            await until(pilot, lambda: table.row_count == 2 and "NO REPLY" in shown(app)["frames"])
            rows = [[str(cell) for cell in table.get_row_at(at)] for at in range(2)]
            assert [cell.strip() for cell in rows[0]] == ["x", "moving", "1.500 mm", "2.000", "60.0", "", "###  0.70s"]
            assert [cell.strip() for cell in rows[1]][:2] == ["y", "FAULT"]
            assert table.virtual_size.width <= size[0]
            text = shown(app)
            assert "load 23%" in text["buses"]
            assert "/dev/ttyUSB0" in text["buses"]
            # The notice is wrapped: it may hold what another test has left in the log.
            assert all(len(line) <= size[0] - 2 for part in ("buses", "frames") for line in text[part].splitlines())
            assert "read position -> 16384 counts" in text["frames"]
            assert "01 04 00 31 00 03" in text["frames"]
            assert "NO REPLY" in text["frames"]
            assert "y: over current" in text["notice"]
            await pilot.press("down", "s", "space", "e")
            await until(pilot, lambda: len(buses.asked) == 3)
            assert buses.asked == ["stop y", "stop all", "emergency stop"]
            await pilot.press("p")
            await until(pilot, lambda: "PAUSED" in shown(app)["notice"])
            assert "PAUSED" in shown(app)["notice"]
            await pilot.press("space")  # also while the view is held
            await until(pilot, lambda: len(buses.asked) == 4)
            assert buses.asked[-1] == "stop all"
            await pilot.press("p", "q")

    asyncio.run(main())


def test_the_name_of_a_port_that_is_cut_says_so() -> None:
    assert _bus_line("cell", PAIR._replace(port="/dev/serial/by-id/usb-FTDI-if00-port0"), 80).plain.startswith(
        "cell …FTDI-if00-port0 115200"
    )
    assert _bus_line("cell", PAIR._replace(port="/dev/ttyUSB00000"), 80).plain.startswith(
        "cell /dev/ttyUSB00000 115200"
    )


def test_it_ends_when_the_buses_do() -> None:
    async def main() -> None:
        buses = Buses()
        app = MonitorApp(buses, "cell")  # type: ignore[arg-type]
        async with app.run_test(size=(80, 24)) as pilot:
            buses.ended = True
            await until(pilot, lambda: not app.is_running)
        assert not app.is_running

    asyncio.run(main())
