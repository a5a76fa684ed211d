"""A group whose commands are loaded one at a time, so that the help of any of them comes at once."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from rs485bus.cli.commands import COMMANDS, PANELS, LazyCommand
from rs485bus.cli.settings import usual_options


class LazyGroup(TyperGroup):
    """Lists what `COMMANDS` says, and loads what is named."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        for name, command in sorted(COMMANDS.items(), key=lambda item: (PANELS.index(item[1].panel), item[0])):
            self.commands[name] = TyperCommand(
                name, help=command.summary, short_help=command.summary, rich_help_panel=command.panel
            )
        self._loaded: set[str] = set()

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that the arguments name, loaded."""
        name = args[0] if args else ""
        if name in COMMANDS and name not in self._loaded:
            self.commands[name] = load(name, COMMANDS[name])
            self._loaded.add(name)
        return super().resolve_command(ctx, args)


def load(name: str, command: LazyCommand) -> Any:
    """A command, with the options that all have."""
    module, _, attribute = command.where.partition(":")
    found = getattr(import_module(module), attribute)
    if isinstance(found, typer.Typer):
        loaded = typer.main.get_command(found)
    else:
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        alone.command(name)(found)
        loaded = typer.main.get_command(alone)
    loaded.name = name
    for leaf in _leaves(loaded):
        leaf.params.extend(usual_options())
    return loaded


def _leaves(command: Any) -> Iterable[Any]:
    """The commands that do something, in a group of groups."""
    if isinstance(command, TyperGroup):
        for inner in command.commands.values():
            yield from _leaves(inner)
    else:
        yield command
