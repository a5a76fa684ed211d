"""Every example runs as it is, on virtual drives, and says nothing on stderr."""

import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))


@pytest.fixture(scope="module")
def runs() -> Iterator[dict[Path, "Future[subprocess.CompletedProcess[str]]"]]:
    """Two at a time: they mostly wait for motors."""

    def run(example: Path) -> "subprocess.CompletedProcess[str]":
        command = (sys.executable, str(example))
        return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)

    with ThreadPoolExecutor(2) as pool:
        yield {example: pool.submit(run, example) for example in EXAMPLES}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_in_real_time(
    example: Path, runs: dict[Path, "Future[subprocess.CompletedProcess[str]]"]
) -> None:
    result = runs[example].result()
    assert result.returncode == 0, result.stderr
    assert result.stdout
    assert result.stderr == ""
