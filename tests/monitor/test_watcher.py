"""What the monitor sees, in virtual time; and that it starves nothing."""

from __future__ import annotations

import asyncio

import pytest

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.monitor.watcher import Watcher
from rs485bus.sim import Machine, SimMks, SimTlr, SimZlac, VirtualLine
from tests.integration.support import virtual


@virtual
async def test_it_sees_positions_targets_set_points_and_margins() -> None:
    line = VirtualLine(SimMks(1, machine=Machine(home_switch=-1.0)), SimZlac(3), SimTlr(4), baudrate=115200)
    async with open_bus(line) as bus:
        x, base, y = MksServo(bus, 1, units_per_turn=8.0, reverse=True), Zlac8015d(bus, 3), TlrStepper(bus, 4)
        axes = {"x": x, "left": base.left, "right": base.right, "y": y}
        watcher = Watcher({"main": bus}, axes, {"x": "mm"}, {"left": "left", "right": "right"})
        watcher.start()
        async with bus.watchdog(x, base, timeout=1.0):
            for axis in (x, base.left, y):
                await axis.enable()
            moves = [x.move_to(8.0, rpm=60), y.move_to(2.0, rpm=60)]
            base.left.run(30)
            await asyncio.sleep(0.7)
            seen = {axis.name: axis for axis in watcher.snapshot().axes}
            assert {name: axis.state for name, axis in seen.items()} == {
                "x": "moving",
                "left": "moving",
                "right": "stands",
                "y": "moving",
            }
            assert seen["x"].position is not None
            assert 1.0 < seen["x"].position < 7.0
            assert seen["x"].target == pytest.approx(8.0)
            assert seen["x"].unit == "mm"
            assert seen["x"].rpm == pytest.approx(60, rel=0.1)
            assert seen["left"].rpm == pytest.approx(30, rel=0.1)
            assert seen["y"].target == pytest.approx(2.0)
            assert seen["left"].set_point == 30
            assert seen["left"].target is None
            assert seen["right"].set_point in (None, 0)
            assert seen["x"].margin is not None
            assert 0.5 < seen["x"].margin <= 1.0
            assert seen["x"].watchdog == 1.0
            assert seen["y"].margin is None
            (pair,) = watcher.snapshot().buses
            assert 0.02 < pair.load < 0.6
            assert pair.rate > 20
            assert pair.latency is not None
            assert pair.families == {1: "MKS", 3: "ZLAC", 4: "TL-R"}
            assert pair.latest[-1].reply
            watcher.stop("x")
            await asyncio.sleep(0.5)
            assert {axis.name: axis.notice for axis in watcher.snapshot().axes}["x"] == "stopped, stands"
            watcher.stop_all()
            await asyncio.sleep(1.5)
            after = watcher.snapshot().axes
            assert [axis.state for axis in after] == ["stands"] * 4
            assert {axis.notice for axis in after} == {"stopped, stands"}
            await asyncio.gather(*moves, return_exceptions=True)
        assert {axis.name: axis.margin for axis in watcher.snapshot().axes}["x"] is None
        await watcher.aclose()


@virtual
async def test_a_drive_that_is_silent_and_a_port_that_is_gone_are_told() -> None:
    line = VirtualLine(SimMks(1), SimMks(2), baudrate=115200)
    async with open_bus(line) as bus:
        watcher = Watcher({"main": bus}, {"a": MksServo(bus, 1), "b": MksServo(bus, 2)})
        watcher.start()
        await asyncio.sleep(1)
        gone = line.pair.devices.pop()
        await asyncio.sleep(2)
        assert [axis.state for axis in watcher.snapshot().axes] == ["stands", "SILENT"]
        assert watcher.snapshot().buses[0].unanswered > 0
        bus.emergency_stop()
        await asyncio.sleep(0.1)
        assert watcher.snapshot().axes[0].state == "E-STOP"
        line.unplug()
        await asyncio.sleep(0.5)
        assert [axis.state for axis in watcher.snapshot().axes] == ["NO PORT"] * 2
        assert not watcher.snapshot().buses[0].connected
        line.pair.devices.append(gone)
        line.plug()
        await asyncio.sleep(0.5)
        await watcher.aclose()


@virtual
async def test_a_trip_is_news() -> None:
    line = VirtualLine(SimMks(1), SimMks(2), baudrate=115200)
    async with open_bus(line) as bus:
        axes = {"a": MksServo(bus, 1), "b": MksServo(bus, 2)}
        watcher = Watcher({"main": bus}, axes)
        watcher.start()
        async with bus.watchdog(*axes.values(), timeout=1.0):
            for axis in axes.values():
                await axis.enable()
            assert [axis.notice for axis in watcher.snapshot().axes] == ["", ""]
            gone = line.pair.devices.pop()
            await asyncio.sleep(1.5)
            line.pair.devices.append(gone)
            await asyncio.sleep(0.5)
            calm, tripped = watcher.snapshot().axes
            assert calm.notice == ""
            assert "trip" in tripped.notice
        await watcher.aclose()


@virtual
async def test_watching_as_often_as_can_be_starves_no_watchdog() -> None:
    count = 8
    line = VirtualLine(*(SimMks(address) for address in range(1, count + 1)), baudrate=38400)
    async with open_bus(line) as bus:
        axes = {f"a{address}": MksServo(bus, address) for address in range(1, count + 1)}
        async with bus.watchdog(*axes.values(), timeout=1.0) as guard:
            for axis in axes.values():
                axis.enable()
                axis.run(60)
            watcher = Watcher({"main": bus}, axes, every=0.01)
            watcher.start()
            await asyncio.sleep(20)
            await watcher.aclose()
            reports = guard.report()
            assert all(report.trips == 0 for report in reports)
            assert max(report.longest for report in reports) < 0.75
            for axis in axes.values():
                axis.stop()
