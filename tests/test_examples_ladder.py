"""The examples are a ladder: each is on it, and each runs on the real thing, too."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "examples"
LADDER = (FOLDER / "README.md").read_text(encoding="utf-8")
EXAMPLES = sorted(path.name for path in FOLDER.glob("*.py"))


def test_every_example_is_on_the_ladder() -> None:
    assert sorted(set(re.findall(r"\]\((\w+\.py)\)", LADDER))) == EXAMPLES, "examples/README.md lists them"


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_says_how_it_is_run_and_takes_a_port(name: str) -> None:
    text = (FOLDER / name).read_text(encoding="utf-8")
    assert f"python examples/{name} --port " in text
    assert '"--port"' in text
