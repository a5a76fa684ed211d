"""The reference, `python -m pdoc rs485bus`, says of every public name what it is."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Any

from rs485bus.blocking.mirror import HIDDEN

MODULES = (
    "rs485bus",
    "rs485bus.sim",
    "rs485bus.plant",
    "rs485bus.compat",
    "rs485bus.devices.mks",
    "rs485bus.devices.zlac",
    "rs485bus.devices.tlr",
)
TIMES = ("timeout", "duration", "lease", "every")
"""Parameters that are times: who reads of them must read the unit."""


def public() -> Iterator[tuple[str, Any]]:
    """Every public name, with what it stands for."""
    seen: set[Any] = set()
    for module in MODULES:
        found = importlib.import_module(module)
        yield module, found
        for name in found.__all__:
            value = getattr(found, name)
            if not isinstance(value, type | FunctionType) or value in seen:
                continue
            seen.add(value)
            yield f"{module}.{name}", value
            if isinstance(value, type):
                yield from members(f"{module}.{name}", value)
    errors = importlib.import_module("rs485bus.errors")
    yield from ((f"rs485bus.errors.{name}", value) for name, value in vars(errors).items() if isinstance(value, type))


def members(where: str, cls: type) -> Iterator[tuple[str, Any]]:
    """The public methods and properties of a class, but those of Python's own."""
    try:
        offered = dir(cls) if cls.__dir__ is object.__dir__ else object.__new__(cls).__dir__()
    except Exception:  # it depends on what an instance holds
        offered = dir(cls)
    for name in sorted(offered):
        if name.startswith("_") or name in HIDDEN:
            continue
        if any(name in vars(base) for base in cls.__mro__ if not base.__module__.startswith("rs485bus")):
            continue
        member = inspect.getattr_static(cls, name, None)
        home = getattr(member.fget if isinstance(member, property) else member, "__module__", "") or ""
        if isinstance(member, FunctionType | property) and home.startswith("rs485bus"):
            yield f"{where}.{name}", getattr(cls, name)


NAMES = dict(public())


def test_no_public_name_is_without_a_docstring() -> None:
    missing = [name for name, value in NAMES.items() if not inspect.getdoc(value)]
    assert not missing, missing


def test_where_a_time_is_asked_for_its_unit_is_said() -> None:
    silent = []
    for name, value in NAMES.items():
        if isinstance(value, FunctionType) and set(TIMES) & set(inspect.signature(value).parameters):
            text = inspect.getdoc(value) or ""
            if not re.search(r"seconds?\b| s\b|as for|As `|Arguments and errors|The same", text):
                silent.append(name)
    assert not silent, silent


OF_PYTHON = ("TypeError", "AttributeError", "KeyError", "StopAsyncIteration", "NotImplementedError")
"""Errors of a program's text, which nobody handles."""


def raised_by(function: FunctionType) -> set[str]:
    """The errors that a function raises itself, by name."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    calls = [node.exc.func for node in ast.walk(tree) if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)]
    return {called.id for called in calls if isinstance(called, ast.Name)} - {*OF_PYTHON, "Refusal"}


def test_what_a_public_name_raises_is_said() -> None:
    silent = []
    for name, value in NAMES.items():
        function = value.fget if isinstance(value, property) else value
        if isinstance(value, type):
            function = vars(value).get("__init__")
        text = inspect.getdoc(value) or ""
        written = isinstance(function, FunctionType) and not function.__code__.co_filename.startswith("<")
        if written and not re.search(r"as for|As `|Arguments and errors|The same", text):
            silent += [f"{name}: {error}" for error in raised_by(function) if error not in text]
    assert not silent, silent


def test_pdoc_makes_pages_of_it(tmp_path: Path) -> None:
    command = (sys.executable, "-m", "pdoc", "rs485bus.errors", "rs485bus.blocking", "-o", str(tmp_path))
    result = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert result.returncode == 0, result.stderr
    page = (tmp_path / "rs485bus" / "blocking.html").read_text()
    assert "open_bus" in page


def test_what_an_applications_annotations_need_is_imported_from_the_package_itself() -> None:
    package = importlib.import_module("rs485bus")
    for name in (
        "Axis",
        "BusStats",
        "EmergencyReport",
        "GroupMove",
        "Handle",
        "LineSettings",
        "Move",
        "Record",
        "Unit",
    ):
        assert isinstance(getattr(package, name), type)
        assert name in package.__all__
