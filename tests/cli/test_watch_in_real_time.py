"""`rs485bus record` and `monitor`, as a user runs them."""

import subprocess
import sys
from pathlib import Path

from rs485bus.capture import load
from tests.real.support import posix

COMMAND = (sys.executable, "-m", "rs485bus")


@posix
def test_record_asks_the_axes_and_writes_a_capture(tmp_path: Path) -> None:
    out = tmp_path / "cell.jsonl"
    arguments = ("record", str(out), "--sim", "--mks", "7", "--zlac", "8", "--seconds", "2", "--every", "0.1")
    done = subprocess.run((*COMMAND, *arguments), capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"Recording to {out}. It takes 2 s." in done.stdout
    capture = load(out)
    assert capture.families == {7: "MKS", 8: "ZLAC"}
    assert f"{out}: {len(capture.exchanges) + 2} entries." in done.stdout
    assert len(capture.exchanges) > 10


def test_the_monitor_wants_a_terminal() -> None:
    done = subprocess.run((*COMMAND, "monitor", "--sim"), capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "run it in one, not in a pipe" in done.stderr
    assert "Traceback" not in done.stderr


def test_without_textual_it_says_what_to_install() -> None:
    script = "import sys; sys.modules['textual'] = None; sys.argv = ['rs485bus', 'monitor', '--sim']\n"
    script += "from rs485bus.cli import main; main()"
    done = subprocess.run((sys.executable, "-c", script), capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode != 0
    assert 'pip install "rs485bus[monitor]"' in done.stderr
    assert "Traceback" not in done.stderr
