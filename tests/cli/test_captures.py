"""`rs485bus explain`, `plot` and `pcap`, as a user runs them."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rs485bus.cli.app import app
from rs485bus.cli.process import tell
from tests.capture.support import cell, work
from tests.integration.support import virtual


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A capture file of a cell at work."""
    path = tmp_path_factory.mktemp("captures") / "cell.jsonl"

    @virtual
    async def record() -> None:
        await work(cell(), [], path)

    record()
    return str(path)


def call(*arguments: str) -> tuple[int, str, str]:
    """Run the command in this process: its exit code, its output, and what it said of an error."""
    result = CliRunner().invoke(app, arguments, prog_name="rs485bus")
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        assert isinstance(result.exception, ValueError), result.exception
        return tell(result.exception), result.stdout, f"{result.stderr}{result.exception}"
    return result.exit_code, result.stdout, result.stderr


def test_explain_says_each_frame_in_words_and_adds_up(capture: str) -> None:
    code, said, _ = call("explain", capture)
    assert code == 0
    assert "1 MKS  command write enable yes -> done" in said
    assert "3 ZLAC stop    write left target velocity" in said
    assert "!" in said
    assert "REFUSED: exception 02, illegal register address" in said
    assert "frames in" in said
    assert all(len(line) <= 80 for line in said.splitlines() if line.lstrip().startswith(("unit family", "1 MKS   ")))


def test_explain_shows_errors_alone_or_a_part_or_the_bytes(capture: str) -> None:
    _, said, _ = call("explain", capture, "--errors")
    assert said.count(" -> ") == said.count("!") == 1
    _, said, _ = call("explain", capture, "--unit", "9", "--hex")
    assert "09 06 00 28 00 01" in said
    assert "MKS  " not in said.split("unit family")[0]
    _, whole, _ = call("explain", capture)
    _, part, _ = call("explain", capture, "--from", "1", "--to", "1.4")
    assert 5 < part.count(" -> ") < whole.count(" -> ") / 2


def test_explain_for_programs(capture: str) -> None:
    _, said, _ = call("explain", capture, "--json")
    told = json.loads(said)
    assert {"at", "unit", "family", "asked", "answered", "error", "latency"} <= told["exchanges"][0].keys()
    assert {unit["address"]: unit["family"] for unit in told["summary"]["units"]} == {
        1: "MKS",
        3: "ZLAC",
        4: "TL-R",
        9: None,
    }
    assert sum(unit["requests"] + unit["repeated"] for unit in told["summary"]["units"]) == len(told["exchanges"])


def test_plot_and_pcap_write_their_files(capture: str, tmp_path: Path) -> None:
    code, said, _ = call("plot", capture, "-o", str(tmp_path / "a.svg"), "--to", "1")
    assert (code, "exchanges" in said) == (0, True)
    code, said, _ = call("pcap", capture, str(tmp_path / "a.pcap"))
    assert (code, "packets" in said) == (0, True)
    assert (tmp_path / "a.svg").stat().st_size > 10_000
    assert (tmp_path / "a.pcap").read_bytes()[:4] == bytes.fromhex("4d3cb2a1")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("explain", "nope.jsonl"), "There is no file nope.jsonl. Make a capture with `rs485bus record`."),
        (("explain", "."), "is a folder"),
        (("explain", __file__), "is no capture: it is no JSON"),
        (("explain", "CAPTURE", "--from", "1000"), "nothing happened between 1000 s and the end. The capture spans"),
        (("plot", "CAPTURE", "-o", "a.gif"), "must end in .svg, .png, .pdf, .html"),
        (("plot", "CAPTURE", "-o", "/nope/a.svg"), "There is no folder /nope"),
        (("pcap", "CAPTURE", "/nope/a.pcap"), "There is no folder /nope"),
    ],
)
def test_wrong_input_is_told_in_words(capture: str, arguments: tuple[str, ...], said: str) -> None:
    code, _, error = call(*(capture if each == "CAPTURE" else each for each in arguments))
    assert code == 2
    assert said in error


def test_a_broken_line_is_told_and_the_rest_shown(capture: str, tmp_path: Path) -> None:
    lines = Path(capture).read_text().splitlines(keepends=True)
    broken = tmp_path / "broken.jsonl"
    broken.write_text("".join([*lines[:40], '{"at": 1, "unit"\n', *lines[40:60]]) + '{"at": 2.0, "un')
    code, said, error = call("explain", str(broken))
    assert code == 0
    assert said.count(" -> ") > 40
    assert "line 41 was left out" in error
    assert "the program was ended while it wrote" in error
