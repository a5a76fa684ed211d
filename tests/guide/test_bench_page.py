"""The page of the bench is so: its ten commands do what it says, one after the other, on virtual drives; and its blocks
of Python run."""

from __future__ import annotations

import asyncio
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from rs485bus import MksServo, Plant, TlrStepper
from rs485bus.cli.serve import FAMILIES
from rs485bus.sim import VirtualClockLoop, VirtualLine
from tests.cli.support import Ended, invoke
from tests.guide.support import Block, blocks, pages
from tests.integration.support import virtual

PAGE = pages()["bench.md"]
PLANT_FILE = next(block.text for block in blocks(PAGE) if block.language == "toml")
DOES = {
    "ports": "",
    "scan --expect": "MKS SERVO",
    "setup": "Done: address 1 at 115200 bit/s.",
    "scan -b": "plant.toml is written. Next: rs485bus check plant.toml",
    "check": "plant.toml is right: cell, 4 axes on 1 bus, 1 group, a vehicle.",
    "group xy home": "x: 0 mm y: 0 turns",
    "group xy move-to": "x: 2 mm y: 3 turns They started within",
    "record": "capture.jsonl: ",
    "plot": "capture.html: ",
}
"""What each command says. `jog` and `monitor` want a terminal: they are driven by keys elsewhere."""
BY_KEYS = ("jog", "monitor")


class Pair:
    """What hangs on the port of the page: first one new drive, then those of the plant file."""

    def __init__(self) -> None:
        self.first = FAMILIES["MKS"](1)
        self.first.baudrate = 38400
        self._others = [FAMILIES["TL-R"](2), FAMILIES["ZLAC"](3)]
        self.alone = True

    def at(self, port: str, *, baudrate: int | None, **settings: Any) -> Any:
        assert port == "/dev/ttyUSB0"
        drives = [self.first] if self.alone else [self.first, *self._others]
        return lambda: VirtualLine(*drives, baudrate=baudrate or 115200)


@pytest.fixture
def pair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Pair:
    """The pair, and a folder to work in. Commands run in virtual time, and what they ask is answered as proposed."""
    pair = Pair()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rs485bus.bus.opening.transport_at", pair.at)
    monkeypatch.setattr("rs485bus.cli.process.asyncio.Runner", _VirtualRunner)
    monkeypatch.setattr("typer.confirm", lambda question: True)
    monkeypatch.setattr("typer.prompt", lambda question, **settings: settings["default"])
    return pair


class _VirtualRunner(asyncio.Runner):
    def __init__(self, *, loop_factory: Any = None) -> None:
        super().__init__(loop_factory=VirtualClockLoop)


def commands() -> list[list[str]]:
    """The arguments of each command of the page's first block."""
    block = next(block for block in blocks(PAGE) if block.language == "sh")
    lines = [shlex.split(line, comments=True) for line in block.text.splitlines()]
    return [words[1:] for words in lines if words[0] == "rs485bus"]


def test_the_commands_do_what_the_page_says_one_after_the_other(pair: Pair) -> None:
    said: dict[str, Ended] = {}
    for arguments in commands():
        called = " ".join(arguments)
        if arguments[0] in BY_KEYS:
            continue
        result = said[called] = invoke(*arguments)
        assert result.returncode == 0, (called, result.said)
        if arguments[0] == "setup":
            pair.alone = False
        if "--write" in arguments:
            Path("plant.toml").write_text(PLANT_FILE)  # "after names, units and limits were written into it"
    for called, words in DOES.items():
        name, _, rest = called.partition(" ")
        (one,) = [result for command, result in said.items() if command.startswith(name) and rest in command]
        assert words in one.said, (called, one.said)
    assert {command.split()[0] for command in said} | set(BY_KEYS) == {arguments[0] for arguments in commands()}


@pytest.mark.parametrize("block", [block for block in blocks(PAGE) if block.language == "py"], ids=str)
@virtual
async def test_each_block_of_python_runs(block: Block, pair: Pair, tmp_path: Path) -> None:
    (tmp_path / "plant.toml").write_text(PLANT_FILE)
    pair.alone = False
    pair.first.baudrate = 115200
    names: dict[str, Any] = {"Plant": Plant, "MksServo": MksServo, "TlrStepper": TlrStepper}
    indented = re.sub("^", "    ", block.text, flags=re.MULTILINE)
    source = f"async def block():\n{indented}\n    return locals()"
    exec(compile(source, "bench.md", "exec", dont_inherit=True), names)
    found = await names["block"]()
    if "Cell" in found:
        cell = found["Cell"].load("plant.toml", sim=True)
        assert cell.file.axes.keys() >= {"x", "y"}
