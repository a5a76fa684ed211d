"""`monitor` and `record` with `--broker`: they read along, and stop, through the service."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from benchmarks.service.mosquitto import Mosquitto
from rs485bus.capture import load
from rs485bus.cli.over_broker import Served
from rs485bus.cli.watch_over_broker import run_record
from rs485bus.errors import MoveCancelled
from rs485bus.monitor.served import ServedWatcher
from rs485bus.service.schema import TrafficReport
from tests.real.support import in_real_time
from tests.service.serving import CELL, connect, serving

GUARDED = CELL.replace("address = 1\n", 'address = 1\nunit = "mm"\nunits_per_turn = 8.0\nwatchdog = 1.0\n')


def test_a_served_plant_is_watched_and_stopped_as_one_of_this_program(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url, GUARDED) as (plant, _),
            connect(broker.url, plant=plant.name) as cell,
            connect(broker.url, plant=plant.name) as looks,
        ):
            watcher = ServedWatcher(looks)
            watcher.start()
            await cell.x.enable()
            move = cell.x.move_to(800.0, rpm=60)
            await asyncio.sleep(1.5)
            seen = watcher.snapshot()
            x, y = seen.axes
            assert (x.state, y.state, x.unit, x.target) == ("moving", "stands", "mm", 800.0)
            assert x.position is not None
            assert 0 < x.position < 40
            assert x.rpm == pytest.approx(60, rel=0.2)
            assert x.watchdog == 1.0
            assert x.margin is not None
            assert 0 < x.margin <= 1.0
            assert y.watchdog is None
            (pair,) = seen.buses
            assert (pair.connected, pair.baudrate, pair.families) == (True, 115200, {1: "MKS", 2: "MKS"})
            assert pair.rate > 5
            assert any(exchange.urgency == "command" for exchange in pair.latest)
            watcher.stop("x")
            with pytest.raises(MoveCancelled):
                await move
            await asyncio.sleep(0.5)
            stopped = watcher.snapshot().axes[0]
            assert (stopped.state, stopped.notice) == ("stands", "stopped, stands")
            await watcher.aclose()

        watcher.start()
        assert {axis.state for axis in watcher.snapshot().axes} == {"NO PORT"}
        await watcher.aclose()

    in_real_time(main, 30)


def test_a_served_plant_is_recorded_as_one_of_this_program(
    tmp_path: Path, broker: Mosquitto, capsys: pytest.CaptureFixture[str]
) -> None:
    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _):
            served = Served(broker.url, Path(plant.name), None, None, None)
            out = tmp_path / "c.jsonl"
            code = await run_record(served, out, every=0.1, seconds=1.5, max_bytes=1_000_000, keep=1)
            assert code == 0
            capture = load(out)
            assert capture.families == {1: "MKS", 2: "MKS"}
            assert len(capture.exchanges) > 10
            assert all(-0.1 < exchange.at < exchange.ended < 3 for exchange in capture.exchanges)
            told = {(record.request, record.reply) for record in plant.buses["main"].flight}
            assert {(exchange.request, exchange.reply) for exchange in capture.exchanges} <= told
        assert f"Recording to {out}. It takes 1.5 s." in capsys.readouterr().out

    in_real_time(main, 30)


def test_exchanges_that_were_lost_on_the_way_are_counted(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _), connect(broker.url, plant=plant.name) as looks:
            watcher = ServedWatcher(looks)
            for before in (5, 5, 9):
                watcher._see("main", TrafficReport(before=before, lines=[]))
            assert watcher.lost == {"main": 4}

    in_real_time(main, 20)
