"""`rs485bus serve`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from rs485bus.cli.options import PlantPath, Sim

# typer reads these at run time: Optional, for Python 3.11 and all versions of typer.
File = Optional[Path]  # noqa: UP045
Text = Optional[str]  # noqa: UP045


def serve(
    plant: PlantPath,
    broker: Annotated[str, typer.Option(help="mqtt://host, mqtts://host:8883 with TLS.")] = "mqtt://127.0.0.1",
    user: Annotated[Text, typer.Option(help="As whom the broker is used.")] = None,
    password_file: Annotated[File, typer.Option(help="A file with the password.")] = None,
    ca: Annotated[File, typer.Option(help="The certificate of who signs for the broker.")] = None,
    certificate: Annotated[File, typer.Option(help="The service's own certificate.")] = None,
    key: Annotated[File, typer.Option(help="The key of the certificate.")] = None,
    prefix: Annotated[str, typer.Option(help="What the topics begin with.")] = "rs485bus",
    ledger: Annotated[
        File, typer.Option(help="Where requests are remembered; without, in the state directory of the user.")
    ] = None,
    rate: Annotated[float, typer.Option(min=0.1, max=50, help="States a second of an axis that moves.")] = 5.0,
    home_assistant: Annotated[bool, typer.Option(help="Have Home Assistant find states and stops.")] = False,
    sim: Sim = False,
) -> None:
    """Serve a plant over an MQTT 5 broker, for other programs and other hosts, until interrupted."""
    from rs485bus.cli.process import console, start
    from rs485bus.service.broker import Broker
    from rs485bus.service.running import serve_plant

    where = Broker.at(
        broker,
        username=user,
        password=None if password_file is None else password_file.read_text().rstrip("\n"),
        ca=None if ca is None else str(ca),
        certificate=None if certificate is None else str(certificate),
        key=None if key is None else str(key),
    )

    async def run() -> int:
        await serve_plant(
            plant,
            where,
            prefix=prefix,
            ledger=ledger,
            rate=rate,
            home_assistant=home_assistant,
            sim=sim,
            online=lambda name: console().print(f"{name} is served at {where}. Interrupt with Ctrl-C."),
        )
        return 0

    start(run)
