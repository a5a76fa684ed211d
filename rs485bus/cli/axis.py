"""`rs485bus axis` and `rs485bus estop`: one verb for one axis, and everything stopped."""

from __future__ import annotations

import asyncio
import dataclasses
import enum
import json
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from rs485bus.cli.process import DONE, UNKNOWN, WrongUse, console, exit_code, tell
from rs485bus.cli.session import Where, axis_named, open_plant
from rs485bus.errors import NotEnabled, NotSupported, PortBusy
from rs485bus.plant import AxisEntry, Plant

_REFRESH = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """What an axis is to do."""

    verb: str
    value: float | None = None
    rpm: float | None = None
    acceleration: float | None = None
    duration: float | None = None
    timeout: float | None = None

    def check(self) -> None:
        """Refuse what cannot be meant, before anything is opened. Raises `WrongUse`."""
        verb = VERBS.get(self.verb)
        if verb is None:
            raise WrongUse(f"There is no verb {self.verb!r}. There is: {', '.join(VERBS)}.")
        if verb.value and self.value is None:
            raise WrongUse(f"{self.verb} needs a number: rs485bus axis NAME {self.verb} {verb.value}")
        if not verb.value and self.value is not None:
            raise WrongUse(f"{self.verb} takes no number; {self.value:g} was given.")
        for option in ("rpm", "acceleration", "duration", "timeout"):
            if getattr(self, option) is not None and option not in verb.options:
                raise WrongUse(f"{self.verb} takes no --{option}.")


@dataclass(frozen=True, slots=True)
class Verb:
    """What a verb needs, and how it is said to an axis."""

    ask: Callable[[Any, Order], Any]
    """Calls the axis; returns what is awaited."""
    value: str = ""
    """What its number is, in messages; empty for none."""
    options: tuple[str, ...] = ()
    moves: bool = False
    """It sets in motion: the axis is enabled first, and guarded meanwhile."""
    past: str = "done"


def _pace(order: Order) -> dict[str, float | None]:
    return {"rpm": order.rpm, "acceleration": order.acceleration}


VERBS: dict[str, Verb] = {
    "status": Verb(lambda axis, order: axis.position()),
    "enable": Verb(lambda axis, order: axis.enable(), past="is enabled and holds its position"),
    "disable": Verb(lambda axis, order: axis.disable(), past="is let go"),
    "home": Verb(
        lambda axis, order: home(axis, order.timeout), options=("timeout",), moves=True, past="has found its origin"
    ),
    "move-to": Verb(
        lambda axis, order: axis.move_to(order.value, **_pace(order)),
        value="POSITION",
        options=("rpm", "acceleration"),
        moves=True,
        past="has arrived",
    ),
    "move-by": Verb(
        lambda axis, order: axis.move_by(order.value, **_pace(order)),
        value="DISTANCE",
        options=("rpm", "acceleration"),
        moves=True,
        past="has arrived",
    ),
    "run": Verb(
        lambda axis, order: axis.run(order.value, acceleration=order.acceleration, duration=order.duration),
        value="RPM",
        options=("acceleration", "duration"),
        moves=True,
        past="has stopped",
    ),
    "stop": Verb(lambda axis, order: axis.stop(), past="was seen to stand"),
    "emergency-stop": Verb(lambda axis, order: axis.emergency_stop(), past="was seen to stand"),
    "zero": Verb(lambda axis, order: axis.set_zero(), past="has its zero here"),
    "clear-fault": Verb(lambda axis, order: _clear_fault(axis), past="reports no fault any more"),
}


def home(axis: Any, timeout: float | None = None) -> Any:
    """Have an axis find its origin. Raises `NotSupported` where its drive cannot."""
    if not hasattr(axis, "home"):
        raise NotSupported(
            f"{axis.name} cannot home by itself: its drive has no such command. Drive it to where its zero is to be "
            "(rs485bus jog), then: axis NAME zero."
        )
    return axis.home() if timeout is None else axis.home(timeout=timeout)


def _clear_fault(axis: Any) -> Any:
    for name in ("clear_fault", "clear_alarm", "clear_faults", "release_stall"):
        if hasattr(axis, name):
            return getattr(axis, name)()
    raise NotSupported(f"{axis.name} has nothing by which a fault is cleared: switch it off and on.")


async def run_order(where: Where, name: str, order: Order, as_json: bool) -> int:
    """Carry one order out and say what came of it. Returns the exit code."""
    out = Console(stderr=True, highlight=False) if as_json else console()
    try:
        result = await _carry_out(where, name, order, out)
    except asyncio.CancelledError as cancelled:
        if as_json:
            tell_interruption({"axis": name, "verb": order.verb}, cancelled)
        raise
    except Exception as error:
        if as_json:
            return tell_failure({"axis": name, "verb": order.verb}, error)
        raise
    if as_json:
        print(json.dumps({"axis": name, "verb": order.verb, "done": True, **result}))
    else:
        for line in _lines(name, order, result):
            out.print(line)
    return DONE


async def _carry_out(where: Where, name: str, order: Order, out: Console) -> dict[str, Any]:
    verb = VERBS[order.verb]
    axis_named(where.file(), name)
    async with open_plant(where, watchdogs=verb.moves) as plant:
        name = axis_named(plant.file, name)
        axis, entry = plant.axes[name], plant.file.axes[name]
        if order.verb == "status":
            return await status_of(plant, name)
        if order.verb == "clear-fault" and entry.side is not None:
            axis = plant.drive(name)  # of both wheels
        if verb.moves or order.verb == "enable":
            await enabled(axis, name, entry)
        handle = verb.ask(axis, order)
        await _watch(plant, name, handle, out)
        if order.verb == "run" and order.duration is None:
            out.print(f"{name} turns at {order.value:g} rpm until it is interrupted with Ctrl-C.")
            await _watch(plant, name, asyncio.get_running_loop().create_future(), out)
        axis = plant.axes[name]
        return {"position": round(await axis.position(), 6), "unit": entry.unit}


async def enabled(axis: Any, name: str, entry: AxisEntry) -> None:
    """Enable an axis. A failure names the command that mends it."""
    try:
        await axis.enable()
    except NotEnabled as error:
        if entry.family == "mks":
            error.add_note(f"From here the work mode is set by: rs485bus settings write {name} mode SR_VFOC")
        raise


async def _watch(plant: Plant, name: str, handle: Any, out: Console) -> None:
    """Wait for a handle; on a terminal, show meanwhile where the axis is."""
    if not out.is_terminal:
        await handle
        return
    axis, unit = plant.axes[name], plant.file.axes[name].unit

    async def show() -> None:
        with Live(console=out, refresh_per_second=10, transient=True) as live:
            while True:
                position, rpm = await axis.position(), await axis.velocity()
                live.update(Text(f"{name}  {position:10.3f} {unit}  {rpm:8.1f} rpm   (Ctrl-C stops it)"))
                await asyncio.sleep(_REFRESH)

    showing = asyncio.create_task(show())
    try:
        await handle
    finally:
        showing.cancel()
        await asyncio.wait([showing])
        if not showing.cancelled():
            showing.exception()  # what matters fails in the handle, too


async def status_of(plant: Plant, name: str) -> dict[str, Any]:
    """What is known of an axis, asked now."""
    axis, entry = plant.axes[name], plant.file.axes[name]
    drive = await plant.drive(name).status()
    part = getattr(drive, entry.side) if entry.side else drive
    details = {**_plain(drive), **_plain(part)} if entry.side else _plain(part)
    for other in entry.facts.sides:
        details.pop(other, None)
    return {
        "family": entry.family,
        "address": entry.address,
        "position": round(await axis.position(), 6),
        "unit": entry.unit,
        "rpm": round(await axis.velocity(), 2),
        "standing": await axis.idle(),
        "drive": details,
    }


def _plain(value: Any) -> Any:
    """A dataclass of a drive's as JSON holds it."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, enum.Flag):
        return [member.name for member in type(value) if member in value and member.name]
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, bool | int | float | str) or value is None:
        return value
    return str(value)


def _lines(name: str, order: Order, result: dict[str, Any]) -> list[str]:
    if order.verb != "status":
        return [f"{name} {VERBS[order.verb].past}: {result['position']:g} {result['unit']}."]
    lines = [
        f"{name} ({result['family']} {result['address']}): {result['position']:g} {result['unit']}, "
        f"{result['rpm']:g} rpm, {'stands' if result['standing'] else 'moves'}"
    ]
    for key, value in result["drive"].items():
        shown = ", ".join(value) or "none" if isinstance(value, list) else value
        lines.append(f"  {key.replace('_', ' '):24} {shown}")
    return lines


def tell_failure(what: dict[str, Any], error: Exception) -> int:
    """Tell a failure to people and to programs. Returns the exit code."""
    message = " ".join([str(error), *getattr(error, "__notes__", [])])
    told = {"error": type(error).__name__, "message": message, "exit_code": exit_code(error)}
    print(json.dumps({**what, "done": False, **told}))
    return tell(error)


def tell_interruption(what: dict[str, Any], cancelled: asyncio.CancelledError) -> None:
    """Tell programs that a command was interrupted, and where the axes stand."""
    message = " ".join(getattr(cancelled, "__notes__", []))
    print(json.dumps({**what, "done": False, "error": "Interrupted", "message": message}))


@asynccontextmanager
async def _held_by_none(opening: AbstractAsyncContextManager[Plant]) -> AsyncIterator[Plant]:
    """Open a plant that is to be stopped. Where another program holds its port, say how that one stops it."""
    try:
        async with opening as plant:
            yield plant
    except PortBusy as error:
        error.add_note(
            "Only the program that holds the port can stop these drives by the bus: interrupt it there, by Ctrl-C or "
            "kill -INT and its number. Or use the hard-wired emergency stop."
        )
        raise


async def stop_all(where: Where, as_json: bool) -> int:
    """Stop every drive as fast as it can, and say which were seen to stand. Returns 3 if one was not."""
    async with _held_by_none(open_plant(where, watchdogs=False)) as plant:
        reports = await plant.emergency_stop()
        devices = [device for report in reports.values() for device in report.devices]
        names = {
            (device.family, device.address): [
                axis for axis, entry in plant.file.axes.items() if entry.address == device.address
            ]
            for device in devices
        }
        if as_json:
            told = [
                {
                    "family": device.family,
                    "address": device.address,
                    "axes": names[device.family, device.address],
                    "standing": device.standing,
                }
                for device in devices
            ]
            print(json.dumps(told, indent=2))
        else:
            for device in devices:
                which = ", ".join(names[device.family, device.address])
                stands = "stands" if device.standing else "[red]was NOT seen to stand[/red]"
                console().print(f"{device.family} {device.address} ({which}) {stands}.")
    if all(device.standing for device in devices):
        return DONE
    print("Look at the machine. Use the hard-wired emergency stop.", file=sys.stderr)
    return UNKNOWN
