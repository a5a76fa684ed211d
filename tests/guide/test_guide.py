"""The guide is so: its blocks run as printed, its commands and links are there, its names are the package's."""

import builtins
import importlib
import importlib.util
import inspect
import pkgutil
import re
from pathlib import Path
from types import FunctionType

import pytest
import typer

import rs485bus
from rs485bus import errors, guide
from rs485bus.cli.commands import COMMANDS
from rs485bus.cli.lazy import load
from rs485bus.plant import PlantFile
from rs485bus.pytest_plugin.clock import VirtualClock
from rs485bus.pytest_plugin.drives import VirtualDrives
from rs485bus.pytest_plugin.faults import LineFaults
from rs485bus.sim import VirtualLine
from tests.guide.support import Block, Page, blocks, pages, prose

PAGES = pages()
README = Path(rs485bus.__file__).parent.parent / "README.md"
TEXTS = {**PAGES, "README.md": README.read_text(encoding="utf-8")}
SHELL = [(page, block) for page, text in TEXTS.items() for block in blocks(text) if block.language == "sh"]


@pytest.mark.parametrize("name", [name for name in TEXTS if "```python" in TEXTS[name]])
def test_every_python_block_of_a_page_runs_as_it_is_printed(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)  # some write captures
    page = Page(monkeypatch)
    try:
        for block in blocks(TEXTS[name]):
            if block.language == "python":
                page.run(block, name)
    finally:
        page.close()
    for test, function in page.names.items():
        if test.startswith("test_") and isinstance(function, FunctionType):
            with pytest.MonkeyPatch.context() as patch, VirtualClock(patch) as clock:
                line = VirtualLine(baudrate=115200)
                fixtures = {
                    "virtual_clock": clock,
                    "virtual_line": line,
                    "virtual_drives": VirtualDrives(line, clock),
                    "line_faults": LineFaults(line),
                }
                function(**{name: fixtures[name] for name in inspect.signature(function).parameters})


@pytest.mark.parametrize(("page", "block"), SHELL, ids=str)
def test_every_command_of_a_page_is_one(page: str, block: Block) -> None:
    for line in re.split(r"\n|&&", block.text):
        words = line.split()
        if words[:1] == ["rs485bus"] and len(words) > 1:
            assert words[1] in COMMANDS, line
            command = load(words[1], COMMANDS[words[1]])
            if hasattr(command, "commands"):
                continue
            known = {option for parameter in command.params for option in parameter.opts}
            assert {word for word in words[2:] if word.startswith("--")} <= known, line
        elif words[1:2] == ["-m"] and words[2] not in ("venv", "pip"):
            assert importlib.util.find_spec(words[2]) is not None, line


TOML = [(page, block) for page, text in TEXTS.items() for block in blocks(text) if block.language == "toml"]


@pytest.mark.parametrize(("page", "block"), TOML, ids=str)
def test_every_plant_file_of_a_page_is_right(page: str, block: Block) -> None:
    if "[buses." in block.text:
        PlantFile.loads(block.text)


@pytest.mark.parametrize("name", TEXTS)
def test_every_link_of_a_page_leads_somewhere(name: str) -> None:
    folder = README.parent if name == "README.md" else Path(guide.__file__).parent
    for target in re.findall(r"\]\(([^)]+)\)", prose(TEXTS[name])):
        if not target.startswith("http"):
            assert (folder / target.partition("#")[0]).exists(), target


def test_every_page_is_in_the_list_and_every_topic_has_a_page() -> None:
    assert {f"{topic}.md" for topic in guide.topics()} == {*PAGES, "repeat-rules.md"}
    assert set(guide.TOPICS) <= set(guide.topics())
    for topic in guide.topics():
        assert guide.page(topic).startswith("# ")
    with pytest.raises(KeyError):
        guide.page("nothing")


def test_the_table_of_repeat_rules_is_made_from_the_registers() -> None:
    from rs485bus.devices.mks import registers

    table = guide.page("repeat-rules")
    rows = [line for line in table.partition("## ZLAC")[0].splitlines() if line.startswith("| ")]
    safe, verified, never = rows[1:]
    assert registers.SET_ZERO.name in verified
    assert registers.CALIBRATE.name in never
    assert registers.EMERGENCY_STOP.name in safe


def test_every_exception_has_one_entry_that_says_what_to_do() -> None:
    known = {
        name for name, value in vars(errors).items() if inspect.isclass(value) and issubclass(value, errors.BusError)
    }
    entries = re.findall(r"^- `(\w+)`: .", PAGES["outcomes.md"], re.MULTILINE)
    assert sorted(entries) == sorted(known - {"BusError"})


STUB = (Path(rs485bus.__file__).parent / "blocking" / "__init__.pyi").read_text(encoding="utf-8")
"""What the blocking face has, attributes of instances included: so has the asynchronous one, but for its own."""
OWNERS = ("bus", "x", "base", "vehicle", "move", "group", "guard", "sensor", "error", "setpoint")
ELSEWHERE = {"aclose", "records", "trips", "waits", "load"}


def every_name() -> set[str]:
    """Everything that a module of the package defines."""
    names: set[str] = set()
    for info in pkgutil.walk_packages(rs485bus.__path__, "rs485bus."):
        if info.name.startswith(("rs485bus.cli", "rs485bus.__main__", "rs485bus.compat.modbus_connection")):
            continue
        names |= set(vars(importlib.import_module(info.name)))
    return names


def test_every_name_on_a_page_is_one_of_the_package() -> None:
    known = every_name() | set(dir(builtins))
    known |= {"ModbusIOException", "AsyncModbusSerialClient", "ModbusSerialClient", "BusConnection"}  # of others
    known |= {"Subject"}  # of the tests
    members = set(re.findall(r"^    (?:def )?(\w+)[(:]", STUB, re.MULTILINE)) | ELSEWHERE
    missing = []
    for page, text in TEXTS.items():
        for span in re.findall(r"`([^`\n]+)`", prose(text)):
            owned = re.match(r"(\w+)\.(\w+)", span)
            if owned and owned.group(1) in OWNERS and owned.group(2) not in members:
                missing.append(f"{page}: {span}")
            made = re.match(r"([A-Z]\w*[a-z]\w*)(\(|$)", span)
            if made and made.group(1) not in known:
                missing.append(f"{page}: {span}")
    assert not missing


def test_the_command_lists_the_pages_and_shows_one(capsys: pytest.CaptureFixture[str]) -> None:
    from rs485bus.cli.guide import show_page, show_topics

    show_topics()
    assert all(topic in capsys.readouterr().out or topic for topic in guide.TOPICS)
    show_page("first")
    assert capsys.readouterr().out == PAGES["first-motion.md"] + "\n"
    with pytest.raises(typer.BadParameter, match="did you mean watchdogs"):
        show_page("watchdgs")
    with pytest.raises(typer.BadParameter, match=r"^there is no page 'nope'; rs485bus guide lists them\.$"):
        show_page("nope")
