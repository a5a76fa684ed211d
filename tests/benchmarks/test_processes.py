"""A line and a client, each in a process of its own, find each other over a real pseudo-terminal."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks import __main__ as harness
from benchmarks.clients.registry import LIBRARIES
from benchmarks.measure import measure
from benchmarks.plan import NOISY, NONE, PACED, Measurement
from benchmarks.processes import ClientFailed, run_client
from benchmarks.setting import Setting
from benchmarks.tasks.task import Task

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals and cores as Linux has them")


@pytest.mark.parametrize("library", LIBRARIES)
def test_it_is_measured_on_a_paced_line(library: str) -> None:
    if LIBRARIES[library].missing:
        pytest.skip(LIBRARIES[library].missing)
    task = Task(library=library, name="share", setting=Setting(units=2), seconds=0.05)
    for _ in range(3):
        result = measure(Measurement("share", task, PACED, 0), (), 0.0, 1)
        assert result["requests"] > 0
        assert result["frames"] >= result["requests"]
        if not LIBRARIES[library].keeps_silence or result["early"] == 0:
            return
    # Where others have the cores, the line hands replies over late, and then a repetition may meet one: not each time.
    raise AssertionError("frames began before t3.5")


def test_on_a_faulty_line_nothing_is_told_that_is_not_so() -> None:
    task = Task(library="rs485bus", name="faulty", seconds=0.5)
    result = measure(Measurement("faulty", task, NOISY, 0), (), 0.0, 1)
    assert result["requests"] > 0
    assert (result["lies"], result["twice"]) == (0, 0)


def test_watched_devices_are_measured_in_virtual_time() -> None:
    task = Task(library="rs485bus", name="watched", seconds=2.0, amount=4)
    result = measure(Measurement("watched", task, NONE, 0), (), 0.0, 1)
    assert 0 < result["unfed"] <= result["allowed"]


def test_a_client_that_fails_says_why() -> None:
    with pytest.raises(ClientFailed, match="PortNotFound"):
        run_client(Task(library="rs485bus", name="share", port="/dev/nonexistent"))


def test_the_command_leaves_a_table_and_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--quick", "--rows", "share", "--libraries", "floor", "rs485bus", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["benchmarks", *arguments])
    assert harness.main() == 0
    assert "share of the limit, 115200 baud" in capsys.readouterr().out
    results = json.loads((tmp_path / "results.json").read_text())
    assert {run["library"] for run in results["runs"]} == {"floor", "rs485bus"}
    assert (tmp_path / "results.md").exists()


@pytest.mark.parametrize("module", ["benchmarks.line", "benchmarks.noisy"])
def test_a_line_does_not_outlive_who_started_it(module: str) -> None:
    start = f"print(Process({module!r}, {{}}).pid, flush=True)"
    script = f"import os; from benchmarks.processes import Process; {start}; os._exit(1)"
    done = subprocess.run((sys.executable, "-c", script), capture_output=True, text=True, timeout=30, check=False)
    pid = int(done.stdout)
    for _ in range(100):
        stat = Path(f"/proc/{pid}/stat")
        if not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] == "Z":
            return
        time.sleep(0.05)
    os.kill(pid, signal.SIGKILL)
    raise AssertionError("it went on")
