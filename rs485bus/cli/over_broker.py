"""`--broker`: one verb for one axis of a served plant, and everything of it stopped."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

from rs485bus.cli.axis import VERBS, Order, tell_failure
from rs485bus.cli.process import DONE, UNKNOWN, WrongUse, console
from rs485bus.errors import NotSupported, StopUnconfirmed
from rs485bus.remote import RemotePlant, connect
from rs485bus.remote.plant import Connecting
from rs485bus.service.broker import Broker

_NOT_SERVED = ("clear-fault",)


class Served:
    """Where a plant is served, as the options of a command say.

    Args:
        broker: the broker's address.
        plant: the plant's name, which `--plant` says.
        user: as whom.
        password_file: a file with the password.
        ca: the certificate of who signs for the broker.

    Raises:
        WrongUse: the plant is not named, or the address is none.
    """

    def __init__(
        self, broker: str, plant: Path | None, user: str | None, password_file: Path | None, ca: Path | None
    ) -> None:
        if plant is None:
            raise WrongUse("With --broker, name the plant as its service does: --plant cell")
        password = None if password_file is None else password_file.read_text().rstrip("\n")
        try:
            self._broker = Broker.at(broker, username=user, password=password, ca=None if ca is None else str(ca))
        except ValueError as error:
            raise WrongUse(str(error)) from None
        self.plant = str(plant)

    def connect(self) -> Connecting:
        """The plant, for the length of a block."""
        return connect(self._broker, plant=self.plant)


async def run_order(served: Served, name: str, order: Order, as_json: bool) -> int:
    """Carry one order out and say what came of it. Returns the exit code."""
    try:
        async with served.connect() as plant:
            result = await _carry_out(plant, name, order)
    except asyncio.CancelledError:
        if as_json:
            print(json.dumps({"axis": name, "verb": order.verb, "done": False, "error": "Interrupted"}))
        raise
    except Exception as error:
        if as_json:
            return tell_failure({"axis": name, "verb": order.verb}, error)
        raise
    if as_json:
        print(json.dumps({"axis": name, "verb": order.verb, "done": True, **result}))
    elif order.verb == "status":
        for key, value in result.items():
            console().print(f"{key:12} {value}", soft_wrap=True)
    else:
        console().print(f"{name} {VERBS[order.verb].past}: {result['position']:g}.", soft_wrap=True)
    return DONE


async def _carry_out(plant: RemotePlant, name: str, order: Order) -> dict[str, Any]:
    if name not in plant.axes:
        raise WrongUse(f"The plant {plant.name} has no axis {name!r}: {', '.join(plant.axes)}.")
    if order.verb in _NOT_SERVED or order.timeout is not None:
        raise NotSupported(f"{order.verb} with these options is not done over a broker: do it where the drives are.")
    axis, verb = plant.axes[name], VERBS[order.verb]
    if order.verb == "status":
        drive = await axis.status() if "status" in axis.facts.verbs else {}
        return {"position": await axis.position(), "rpm": await axis.velocity(), "standing": await axis.idle(), **drive}
    if verb.moves:
        axis.enable()
    await verb.ask(axis, order)
    if order.verb == "run" and order.duration is None:
        console().print(f"{name} turns at {order.value:g} rpm until it is interrupted with Ctrl-C.")
        await asyncio.get_running_loop().create_future()
    return {"position": round(await axis.position(), 6)}


async def stop_all(served: Served, as_json: bool) -> int:
    """Stop every drive of the plant as fast as it can. Returns 3 if one was not seen to stand."""
    async with served.connect() as plant:
        try:
            standing = await plant.emergency_stop()
        except StopUnconfirmed as error:
            print(json.dumps({"standing": False, "message": str(error)}) if as_json else f"{error}", file=sys.stderr)
            return UNKNOWN
    if as_json:
        print(json.dumps([{"axes": [axis], "standing": True} for axis in standing], indent=2))
    else:
        console().print(f"{', '.join(standing)} stand.")
    return DONE
