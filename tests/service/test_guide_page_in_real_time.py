"""What the guide prints about the service is so."""

from __future__ import annotations

import ast
import asyncio
import re
import textwrap
from pathlib import Path
from typing import Any

import pytest

from benchmarks.service.mosquitto import Mosquitto
from rs485bus import remote
from rs485bus.service import schema
from rs485bus.service.topics import Topics
from tests.real.support import in_real_time
from tests.service.guide_page import PAGE, blocks
from tests.service.serving import serving


def test_its_programs_run_as_they_are_printed(tmp_path: Path, broker: Mosquitto) -> None:
    program, set_points, _ = blocks("py")

    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _):

            async def run(code: str) -> None:
                there = code.replace("mqtt://127.0.0.1", broker.url).replace('"cell"', f'"{plant.name}", lease=10')
                names: dict[str, Any] = {"asyncio": asyncio, "remote": remote}
                exec(compile(there.replace("asyncio.run(main())", ""), "guide", "exec"), names)
                await names["main"]()

            await run(program)
            assert await plant.x.position() == pytest.approx(0.0, abs=0.01)
            await run(_as_function(set_points))
            assert await plant.x.position() > 0.1

    in_real_time(main, 60)


def _as_function(block: str) -> str:
    return "async def main():\n" + textwrap.indent(block, "    ")


def test_every_topic_that_it_names_is_one() -> None:
    topics = Topics("cell")
    known = {
        topics.service,
        *(topics.axis("x", what) for what in ("state", "sample", "event")),
        topics.bus("main"),
        topics.traffic("main"),
        topics.request("x", "move_to"),
        topics.reply("CLIENT"),
        topics.presence("CLIENT"),
        topics.gone("CLIENT"),
        topics.setpoint("x"),
        topics.stop,
        topics.emergency_stop,
        topics.refused,
    }
    rows = re.findall(r"^\| (`[^|]+`) \|", PAGE, re.MULTILINE)
    named = {f"{topics.root}/{name}" for row in rows for name in re.findall(r"`([^`]+)`", row)}
    assert named == known


def test_every_message_has_a_schema() -> None:
    told = schema.json_schema()
    assert {"Request", "Answer", "Description", "AxisReport", "SetPoint", "Stop"} <= set(told)
    assert told["Request"]["properties"]["v"]["const"] == schema.VERSION


def test_its_python_is_python() -> None:
    for block in blocks("py"):
        ast.parse(block if "def main" in block else _as_function(block))
