"""The frame of the command: what all of its sub-commands share."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from rs485bus.cli.commands import COMMANDS
from rs485bus.cli.lazy import load
from tests.cli.support import invoke

HEAVY = (
    *("pymodbus", "pydantic", "tomlkit", "textual", "matplotlib"),
    *("rs485bus.bus", "rs485bus.sim", "rs485bus.cli.process"),
)

EVERY_HELP = """
import contextlib, io, json, sys
from rs485bus.cli.commands import COMMANDS
from rs485bus.cli.app import main
loaded = {}
for name in ("", *COMMANDS):
    before = set(sys.modules)
    with contextlib.redirect_stdout(io.StringIO()) as said:
        with contextlib.suppress(SystemExit):
            main([name, "--help"] if name else ["--help"])
    loaded[name] = [len(said.getvalue()), sorted(set(sys.modules) - before if name else set(sys.modules))]
print(json.dumps(loaded))
"""


def test_the_help_of_no_command_loads_what_its_work_needs() -> None:
    result = subprocess.run((sys.executable, "-c", EVERY_HELP), capture_output=True, text=True, check=True)
    for name, (length, modules) in json.loads(result.stdout).items():
        assert length > 200, name
        assert [module for module in modules if module in HEAVY] == [], name


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_of_commands_says_of_each_what_its_own_help_begins_with(name: str) -> None:
    command = load(name, COMMANDS[name])
    assert (command.help or "").strip().splitlines()[0] == COMMANDS[name].summary
    options = {option for parameter in command.params for option in parameter.opts}
    assert {"-v", "--debug"} <= options or hasattr(command, "commands")


def test_an_unknown_command_is_told_with_the_nearest_one() -> None:
    result = invoke("chek")
    assert result.returncode == 2
    assert "Did you mean 'check'" in result.stderr
    assert "Traceback" not in result.stderr


def test_a_missing_extra_of_one_command_is_named() -> None:
    script = "import sys; sys.modules['pydantic'] = None; from rs485bus.cli import main; main()"
    result = subprocess.run(
        (sys.executable, "-c", script, "check", "x.toml"), capture_output=True, text=True, check=False
    )
    assert result.returncode == 1
    assert 'pip install "rs485bus[plant]"' in result.stderr
    assert "Traceback" not in result.stderr


def test_check_tells_each_mistake_and_ends_with_2(tmp_path: Path) -> None:
    path = tmp_path / "plant.toml"
    path.write_text('[buses.main]\nport = "COM3"\nbaudrate = 9600\n[axes.x]\nfamily = "mks"\nadress = 1\n')
    result = invoke("check", str(path))
    assert result.returncode == 2
    assert f'{path}, line 6: axes.x.adress: there is no such key. Did you mean "address"?' in result.stderr
    told = json.loads(invoke("check", "--json", str(path)).stdout)
    assert {"line": 6, "field": "axes.x.adress"}.items() <= told[0]["problems"][1].items()
    path.write_text(path.read_text().replace("adress", "address"))
    result = invoke("check", str(path))
    assert (result.returncode, result.stderr) == (0, "")
    assert "is right: plant, 1 axes on 1 bus." in result.stdout


def test_the_json_schema_knows_the_options_of_each_family() -> None:
    schema = json.loads(invoke("check", "--schema").stdout)
    mks, zlac, tlr = schema["properties"]["axes"]["additionalProperties"]["anyOf"][:3]
    assert "SR_VFOC" in mks["properties"]["mode"]["enum"]
    assert zlac["properties"]["side"] == {"enum": ["left", "right"]}
    assert "watchdog" not in tlr["properties"]


@pytest.mark.parametrize("asks", ["-h", "--help"])
def test_help_is_asked_for_in_either_way(asks: str) -> None:
    for arguments in (("axis", asks), ("settings", "read", asks), (asks,)):
        result = invoke(*arguments)
        assert result.returncode == 0, result.said
        assert "Usage:" in result.said
