"""`rs485bus verify`: the questions that manuals leave open, tried on real drives; options, and a report."""

from __future__ import annotations

import datetime
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomlkit
from rich.console import Console

from rs485bus import __version__
from rs485bus.bench.plant_drive import PlantDrive, drives_of, write_found
from rs485bus.bench.scan import Format, recognise
from rs485bus.bench.verify import questions_of
from rs485bus.bench.verify.question import Question, Result, ask_all
from rs485bus.cli.outputs import check_output
from rs485bus.cli.process import DONE, FAILED, WrongUse, agrees, console
from rs485bus.cli.session import Where, axis_named
from rs485bus.cli.virtual import BAUDRATE
from rs485bus.errors import NoReply
from rs485bus.plant.building import virtual_lines


async def run_verify(
    where: Where, names: list[str], only: list[str], report: Path | None, write: bool, yes: bool
) -> int:
    """Ask some drives, or all. Returns 1 where a question was not answered, or a watchdog is no protection."""
    out = console()
    file = where.file()
    for name in names:
        axis_named(file, name)
    for path in (report, file.path if write else None):
        check_output(path)
    lines = virtual_lines(file) if where.sim else {}
    told: list[dict[str, Any]] = []
    sound = True
    for drive in drives_of(file, lines, names):
        questions = _chosen(questions_of(drive.family), only)
        version = await _version(drive)
        if not _agrees(drive, questions, yes, out):
            out.print(f"{drive.title} was left alone.")
            continue
        results = await ask_all(drive.opened, questions, lambda result: _say(result, out))
        told.append({"drive": _facts(drive, version), "answers": [_table(result) for result in results]})
        options = {key: value for result in results if result.answer for key, value in result.answer.options.items()}
        sound = sound and all(_is_sound(result) for result in results)
        if write and file.path is not None and options:
            write_found(file.path, {("axes", next(iter(drive.axes))): options}, "verified")
            out.print(f"  {file.path} has these options now: {', '.join(options)}.")
        elif options:
            out.print(f"  For its table in a plant file: {_lines(options)}")
    if report is not None and told:
        _write_report(report, told)
        out.print(f"The report is in {report}. Please send it in: it tells everybody how this drive behaves.")
    return DONE if sound and told else FAILED


def _chosen(questions: Sequence[Question], only: list[str]) -> list[Question]:
    names = [question.name for question in questions]
    wrong = [name for name in only if name not in names]
    if wrong:
        raise WrongUse(f"There is no question {wrong[0]!r} for this family. There is: {', '.join(names)}.")
    return [question for question in questions if not only or question.name in only]


async def _version(drive: PlantDrive) -> str:
    """Look whether it is there, and what it runs. Raises `NoReply`."""
    entry = drive.file.buses[drive.bus]
    async with drive.on_bus() as bus:
        found = await recognise(bus, drive.address, entry.baudrate or BAUDRATE, Format(entry.parity, entry.stopbits))
    if found.family != drive.family.name:
        there = "nobody answers" if found.reply_ms is None else f"a {found.title} answers"
        raise NoReply(
            f"{drive.title}: {there} there. rs485bus scan {entry.port} tells who is where.", address=drive.address
        )
    return found.version or ""


def _agrees(drive: PlantDrive, questions: list[Question], yes: bool, out: Console) -> bool:
    out.print(f"[bold]{drive.title}[/bold]")
    for question in questions:
        out.print(f"  {question.asks}" + (f" It {question.does}." if question.does else " Nothing moves."))
    if yes or not any(question.does for question in questions):
        return True
    return agrees("Is it free to turn, and does nothing hang on its shaft that may fall?")


def _say(result: Result, out: Console) -> None:
    if result.answer is None:
        out.print(f"  [red]{result.question.name}: not known.[/red] {result.error}")
    else:
        out.print(f"  {result.question.name}: {result.answer.words}")


def _is_sound(result: Result) -> bool:
    return result.answer is not None and result.answer.measured.get("trips", True) is not False


def _facts(drive: PlantDrive, version: str) -> dict[str, Any]:
    return {"family": drive.family.name, "title": drive.family.title, "address": drive.address, "version": version}


def _table(result: Result) -> dict[str, Any]:
    table: dict[str, Any] = {"question": result.question.name, "asked": result.question.asks}
    if result.answer is None:
        return {**table, "error": result.error}
    said = {"answer": result.answer.words, "options": result.answer.options, "measured": result.answer.measured}
    return {**table, **{key: _told(value) for key, value in said.items() if value}}


def _told(value: Any) -> Any:
    """TOML has no None."""
    if isinstance(value, dict):
        return {key: _told(part) for key, part in value.items() if part is not None}
    return value


def _lines(options: dict[str, Any]) -> str:
    return "; ".join(line for line in tomlkit.dumps(options).splitlines() if line)


def _write_report(path: Path, told: list[dict[str, Any]]) -> None:
    document = tomlkit.document()
    document.update(
        {
            "at": datetime.datetime.now().astimezone().replace(microsecond=0).isoformat(),
            "rs485bus": __version__,
            "system": platform.platform(),
            "drives": told,
        }
    )
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
