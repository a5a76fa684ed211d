"""Through which files a move runs, and which ones the guide names to understand it."""

import re
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import rs485bus
from rs485bus import BusConfig, MksServo, open_bus
from rs485bus.sim import SimMks, VirtualClockLoop, VirtualLine

HOME = Path(rs485bus.__file__).parent
GUIDE = (HOME / "guide" / "architecture.md").read_text()
MOST, IN_MOTION = 65, 22
"""Files that a move runs through, and those of them that are no bus, no wire and no transport."""
LINES = 400


def files_of_a_move() -> set[str]:
    """The files that a move runs through, from its call to the end of its await."""
    seen: set[str] = set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(HOME):
            seen.add(path.relative_to(HOME).as_posix())

    async def go() -> None:
        line = VirtualLine(SimMks(1), baudrate=38400)
        async with open_bus(line, baudrate=38400, config=BusConfig(echo=False)) as bus:
            x = MksServo(bus, 1)
            await x.enable()
            await x.move_to(1.0)
            before = sys.getprofile()
            sys.setprofile(note)
            try:
                await x.move_to(3.0)
            finally:
                sys.setprofile(before)

    loop = VirtualClockLoop()
    try:
        loop.run_until_complete(go())
    finally:
        loop.close()
    return {name for name in seen if not name.startswith("sim/")}


def test_a_move_runs_through_no_more_files_than_it_did() -> None:
    files = files_of_a_move()
    above = {name for name in files if name.startswith(("motion/", "arguments"))}
    assert len(files) <= MOST, sorted(files)
    assert len(above) <= IN_MOTION, sorted(above)


def test_the_guide_names_ten_files_to_understand_it_and_it_runs_through_each() -> None:
    way = GUIDE.partition("## The way of one move")[2].partition("\n## ")[0]
    named = re.findall(r"^\| \d+ \| `([\w/.]+)`", way, re.MULTILINE)
    assert len(named) == 10
    assert set(named) <= files_of_a_move()


def test_no_file_has_more_than_400_lines() -> None:
    long = {
        path.relative_to(HOME).as_posix(): lines
        for path in HOME.rglob("*.py")
        if (lines := len(path.read_text().splitlines())) > LINES
    }
    assert not long
