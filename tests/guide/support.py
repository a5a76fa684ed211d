"""Runs what the guide and the README print: code blocks, on virtual drives, in virtual time."""

from __future__ import annotations

import ast
import asyncio
import inspect
import re
import textwrap
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any

import pytest

from rs485bus import AxisGroup, DifferentialDrive, MksServo, TlrStepper, Zlac8015d, blocking, open_bus
from rs485bus.blocking.loop import shared_loop
from rs485bus.sim import Machine, SimMks, SimTlr, SimUnit, SimZlac, VirtualClockLoop, VirtualLine

_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Block:
    """A block of code on a page."""

    language: str
    text: str
    line: int

    def __str__(self) -> str:
        return f"line {self.line}"


def blocks(text: str) -> list[Block]:
    """The blocks of a page."""
    return [
        Block(match.group(1), match.group(2), text[: match.start()].count("\n") + 2) for match in _BLOCK.finditer(text)
    ]


def a_line() -> VirtualLine:
    """What hangs on every port of the guide: MKS 1 and 2, ZLAC 3, TL-R 4, something else at 7."""
    return VirtualLine(
        SimMks(1, machine=Machine(home_switch=-1.0)),
        SimMks(2),
        SimZlac(3),
        SimTlr(4),
        SimUnit(7, {register: 10 * register for register in range(8)}),
    )


class Page:
    """The Python blocks of a page, run one after the other: what one defines the next one has.

    A block that imports `open_bus` or `blocking` is a program. Any other finds a bus open, with axes on it.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("rs485bus.bus.opening.transport_at", lambda port, **settings: a_line)
        monkeypatch.setattr(shared_loop, "make", VirtualClockLoop)
        monkeypatch.setattr(asyncio, "run", _run)
        monkeypatch.setattr("time.sleep", shared_loop.sleep)
        self.names: dict[str, Any] = {"__name__": "guide", "asyncio": asyncio}

    def run(self, block: Block, page: str) -> None:
        """Run a block; the tests that it defines are left to the caller."""
        padded = "\n" * (block.line - 1) + block.text
        tree = ast.parse(padded)
        flags = ast.PyCF_ALLOW_TOP_LEVEL_AWAIT
        code = compile(tree, page, "exec", flags=flags)
        if code.co_flags & inspect.CO_COROUTINE or not self._is_whole(tree):
            _run(self._on_a_bus(code))
        else:
            exec(code, self.names)

    def close(self) -> None:
        """Close the bus that the blocks of a notebook share."""
        for value in self.names.values():
            if isinstance(value, blocking.Bus) and not value.closed:
                value.close()

    def _is_whole(self, tree: ast.Module) -> bool:
        """Whether a block needs nothing that is not on its page."""
        imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}
        return bool(imported & {"open_bus", "blocking", "Register"}) or any(
            isinstance(value, blocking.Bus) for value in self.names.values()
        )

    async def _on_a_bus(self, code: CodeType) -> None:
        async with open_bus(a_line()) as bus:
            base = Zlac8015d(bus, 3, reverse=(False, True))
            axes = {"x": MksServo(bus, 1), "y": TlrStepper(bus, 4), "base": base}
            names = {**self.names, **axes, "bus": bus, "vehicle": DifferentialDrive(base, 0.085, 0.4)}
            names["group"] = AxisGroup(x=axes["x"], y=axes["y"])
            result = eval(code, names)
            if inspect.iscoroutine(result):
                await result


def _run(main: Any) -> Any:
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        return runner.run(main)


def pages() -> dict[str, str]:
    """The pages of the guide, by their file names."""
    import rs485bus.guide

    folder = Path(rs485bus.guide.__file__).parent
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.md"))}


def prose(text: str) -> str:
    """A page without its blocks."""
    return textwrap.dedent(_BLOCK.sub("", text))
