"""`rs485bus settings`: a drive's settings, and files that hold them."""

from __future__ import annotations

import datetime
import json
import tomllib
from pathlib import Path
from typing import Any

import tomlkit

from rs485bus.bench.drive_settings import MksSettings, Values, differences, settings_of
from rs485bus.cli.outputs import check_new
from rs485bus.cli.process import DONE, FAILED, WrongUse, agrees, console
from rs485bus.cli.session import Where, axis_named, open_plant
from rs485bus.errors import NotSupported


async def show(where: Where, name: str, setting: str | None, as_json: bool) -> int:
    """Print one setting, or all."""
    async with open_plant(where, watchdogs=False) as plant:
        settings = settings_of(plant.drive(axis_named(plant.file, name)))
        if setting is not None:
            settings.check([setting])
        values = await settings.read(None if setting is None else [setting])
    if as_json:
        print(json.dumps(values, indent=2))
        return DONE
    kinds = settings.names()
    width = max(map(len, values))
    for key, value in values.items():
        console().print(f"{key:{width}}  {_shown(value):>12}   {kinds[key]}", markup=False)
    return DONE


async def write_one(where: Where, name: str, setting: str, text: str, yes: bool) -> int:
    """Change one setting, and have the drive keep it."""
    value = parse_value(text)
    async with open_plant(where, watchdogs=False) as plant:
        settings = settings_of(plant.drive(axis_named(plant.file, name)))
        settings.check_values({setting: value})
        before = (await settings.read([setting]))[setting] if settings.readable else None
        if before == value:
            console().print(f"{setting} is {_shown(value)} already.")
            return DONE
        was = "" if before is None else f" from {_shown(before)}"
        if not yes and not agrees(f"Change {setting} of {name}{was} to {_shown(value)}? The drive keeps it."):
            console().print("Nothing was changed.")
            return FAILED
        await settings.write({setting: value})
        if settings.readable:
            now = (await settings.read([setting]))[setting]
            if differences({setting: value}, {setting: now}):
                console().print(f"[red]It reads {_shown(now)} now.[/red] Switch the drive off and on, and look again.")
                return FAILED
    console().print(f"{setting} is {_shown(value)}{'' if settings.readable else ': the drive has acknowledged it'}.")
    return DONE


async def save(where: Where, name: str, path: Path) -> int:
    """Write what a drive is set to into a file."""
    check_new(path)
    async with open_plant(where, watchdogs=False) as plant:
        axis = axis_named(plant.file, name)
        settings, family = settings_of(plant.drive(axis)), plant.file.axes[axis].family
        if isinstance(settings, MksSettings):
            await plant.axes[axis].position()  # it is there
            _save_text(path, f'family = "{family}"\n\n[settings]\n{settings.template()}\n')
            console().print(
                f"{path} names all settings. An MKS drive cannot be asked for them: take the # away from those you "
                "want, and load the file.",
            )
            return DONE
        values = await settings.read()
    document = tomlkit.document()
    document.update({"family": family, "settings": values})
    _save_text(path, tomlkit.dumps(document))
    console().print(f"{path} holds {len(values)} settings of {name}.")
    return DONE


async def diff(where: Where, name: str, path: Path, as_json: bool) -> int:
    """Say where a drive differs from a file. Returns 1 if it does."""
    family, wanted, acknowledged = read_file(path)
    async with open_plant(where, watchdogs=False) as plant:
        axis = axis_named(plant.file, name)
        _check_family(family, plant.file.axes[axis].family, path)
        settings = settings_of(plant.drive(axis))
        settings.check(wanted)
        found = await settings.read(wanted) if settings.readable else acknowledged.get(name, {})
    different = differences(wanted, found)
    if as_json:
        print(json.dumps({key: {"file": one, "drive": other} for key, (one, other) in different.items()}, indent=2))
    else:
        word = "drive" if settings.readable else "acknowledged"
        for key, (one, other) in different.items():
            console().print(f"{key}: file {_shown(one)}, {word} {_shown(other)}", markup=False)
        if not different:
            console().print(
                f"{name} is set as {path} says{'' if settings.readable else ', as far as it acknowledged'}."
            )
    return FAILED if different else DONE


async def load(where: Where, name: str, path: Path, yes: bool) -> int:
    """Set a drive as a file says, and have it keep that."""
    family, wanted, _ = read_file(path)
    out = console()
    async with open_plant(where, watchdogs=False) as plant:
        axis = axis_named(plant.file, name)
        _check_family(family, plant.file.axes[axis].family, path)
        settings = settings_of(plant.drive(axis))
        settings.check_values(wanted)
        found = await settings.read(wanted) if settings.readable else {}
        different = differences(wanted, found)
        if not different:
            out.print(f"{name} is set as {path} says already.")
            return DONE
        for key, (one, other) in different.items():
            out.print(f"{key}: {_shown(one)}" + ("" if other is None else f" (now {_shown(other)})"), markup=False)
        if not yes and not agrees(f"Write these {len(different)} settings to {name}? The drive keeps them."):
            out.print("Nothing was changed.")
            return FAILED
        try:
            await settings.write({key: one for key, (one, _) in different.items()})
        finally:
            if isinstance(settings, MksSettings):
                _note_acknowledged(path, name, settings.acknowledged)
        left = differences(wanted, await settings.read(wanted)) if settings.readable else {}
    for key, (one, other) in left.items():
        out.print(
            f"[red]{key} reads {_shown(other)}, not {_shown(one)}[/red]: switch the drive off and on, and compare."
        )
    if not left:
        out.print(f"{name} is set as {path} says.")
    return FAILED if left else DONE


def read_file(path: Path) -> tuple[str, Values, dict[str, Values]]:
    """A settings file: the family, the settings, and what was acknowledged by which axis.

    Raises:
        WrongUse: it is none.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise WrongUse(f"There is no file {path}. rs485bus settings save NAME {path} makes one.") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise WrongUse(f"{path} cannot be read: {error}") from None
    family, settings = content.get("family"), content.get("settings")
    if not isinstance(family, str) or not isinstance(settings, dict):
        raise WrongUse(f'{path} is no settings file: it begins with family = "mks", and has a table [settings].')
    acknowledged = content.get("acknowledged", {})
    return family, settings, {name: values.get("settings", {}) for name, values in acknowledged.items()}


def _note_acknowledged(path: Path, name: str, values: Values) -> None:
    document = tomlkit.parse(path.read_text(encoding="utf-8"))
    table: Any = document.setdefault("acknowledged", tomlkit.table(is_super_table=True))
    now = datetime.datetime.now().astimezone().replace(microsecond=0)
    table[name] = {"at": now.isoformat(), "settings": values}
    path.write_text(tomlkit.dumps(document), encoding="utf-8")


def _save_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _check_family(said: str, is_: str, path: Path) -> None:
    if said != is_:
        raise NotSupported(f"{path} holds settings of the family {said}, and the drive is of {is_}.")


def parse_value(text: str) -> Any:
    """A value as TOML writes it; a bare word is a text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _shown(value: Any) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:.9g}" if isinstance(value, float) else str(value)
