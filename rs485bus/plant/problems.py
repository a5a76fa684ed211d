"""What is wrong with a plant file, and where: line, field, and what to do about it."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from rs485bus.errors import BusError, PlantFileError

Field = tuple[str, ...]
"""The keys that lead to a value: ("axes", "x", "address")."""

_HEADER = re.compile(r"\s*\[\[?([^\[\]]+)\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*=""")
_PART = re.compile(r"""[A-Za-z0-9_-]+|"[^"]*"|'[^']*'""")


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake."""

    field: str
    """Such as "axes.x.address"; empty for the whole file."""
    message: str
    """What is wrong, and what to do about it."""
    line: int | None = None
    """Counted from 1; None where it was read from no file."""

    def at(self, path: str) -> str:
        """The problem with its place, as compilers say it."""
        place = path if self.line is None else f"{path}, line {self.line}"
        return f"{place}: {self.field}: {self.message}" if self.field else f"{place}: {self.message}"


class Lines:
    """Where each field of a TOML text stands."""

    def __init__(self, text: str = "") -> None:
        self._lines: dict[Field, int] = {}
        table: Field = ()
        quoted = ""
        for number, line in enumerate(text.splitlines(), 1):
            if not quoted:
                if header := _HEADER.match(line):
                    table = _parts(header[1])
                    self._note(table, number)
                elif key := _KEY.match(line):
                    self._note(table + _parts(key[1]), number)
            quoted = _still_quoted(line, quoted)

    def of(self, field: Sequence[str]) -> int | None:
        """The line of a field, or of the nearest one around it that has one."""
        for end in range(len(field), -1, -1):
            if (line := self._lines.get(tuple(field[:end]))) is not None:
                return line
        return None

    def _note(self, field: Field, number: int) -> None:
        for end in range(1, len(field) + 1):
            self._lines.setdefault(field[:end], number)


def _parts(key: str) -> Field:
    return tuple(part.strip("\"'") for part in _PART.findall(key))


def _still_quoted(line: str, quoted: str) -> str:
    """The quotes of a string of several lines that is open behind a line."""
    for mark in re.findall(r'"""|\'\'\'', line):
        if not quoted:
            quoted = mark
        elif mark == quoted:
            quoted = ""
    return quoted


class Problems:
    """Collects the mistakes of one file, to tell them all at once.

    Args:
        path: the file, as the user named it.
        text: what it holds.
    """

    def __init__(self, path: str, text: str = "") -> None:
        self.path = path
        self._lines = Lines(text)
        self._found: list[Problem] = []

    def __len__(self) -> int:
        return len(self._found)

    def add(self, field: Sequence[str], message: str) -> None:
        """Note one."""
        self._found.append(Problem(".".join(field), message, self._lines.of(field)))

    @contextmanager
    def noted(self, field: Sequence[str]) -> Iterator[None]:
        """Note what a block refuses, as a mistake of a field."""
        try:
            yield
        except (BusError, ValueError, TypeError) as error:
            self.add(field, str(error))

    def error(self) -> PlantFileError:
        """All that were noted, as one error."""
        found = sorted(dict.fromkeys(self._found), key=lambda problem: problem.line or 0)
        return PlantFileError("\n".join(problem.at(self.path) for problem in found), found)

    def check(self) -> None:
        """Raise `PlantFileError` if there are any."""
        if self._found:
            raise self.error()


def instead(name: str, known: Iterable[str]) -> str:
    """What somebody may have meant: `; did you mean "address"?`, or what there is."""
    known = sorted(known)
    near = difflib.get_close_matches(name.lower(), known, 1, 0.6)
    if near:
        return f'. Did you mean "{near[0]}"?'
    return f". There is: {', '.join(known)}." if known else "."
