"""`rs485bus check`: plant files, as far as they can be checked without their plant."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

from rs485bus.cli.process import DONE, WRONG_INPUT, console
from rs485bus.errors import PlantFileError
from rs485bus.plant.building import try_out
from rs485bus.plant.file import PlantFile


def check_files(paths: Sequence[str], as_json: bool) -> int:
    """Check some plant files and say what is wrong with each. Returns the exit code."""
    results = [_check(path) for path in paths]
    if as_json:
        print(json.dumps(results, indent=2))
    else:
        for result in results:
            for text in result["text"]:
                if result["right"]:
                    console().print(text)
                else:
                    print(text, file=sys.stderr)
    return DONE if all(result["right"] for result in results) else WRONG_INPUT


def _check(path: str) -> dict[str, Any]:
    try:
        file = PlantFile.load(path)
        try_out(file)
    except PlantFileError as error:
        problems = [
            {"line": problem.line, "field": problem.field, "message": problem.message} for problem in error.problems
        ]
        text = str(error).splitlines()
        return {"file": path, "right": False, "problems": problems or [{"message": str(error)}], "text": text}
    parts = [f"{len(file.axes)} axes on {len(file.buses)} bus{'es' if len(file.buses) > 1 else ''}"]
    if file.groups:
        parts.append(f"{len(file.groups)} group{'s' if len(file.groups) > 1 else ''}")
    if file.vehicle:
        parts.append("a vehicle")
    text = [f"{path} is right: {file.name}, {', '.join(parts)}."]
    return {"file": path, "right": True, "problems": [], "text": text}


def print_schema() -> None:
    """Print the JSON schema of plant files."""
    print(json.dumps(PlantFile.json_schema(), indent=2))
