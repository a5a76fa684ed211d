"""`rs485bus read` and `rs485bus write`."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from rs485bus.cli.options import AxisBaudrate, Json, Plant, Sim, where

# typer reads these at run time.
Port = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option(help="A serial port, or a gateway: socket://host:port, tcp://host."),
]
BusName = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option("--bus", help="Which bus of the plant file, where it has several."),
]
Address = Annotated[int, typer.Argument(help="The device's address.")]
Register = Annotated[str, typer.Argument(help="The first register or coil, like 8193 or 0x2001.")]
Table = Annotated[str, typer.Option(help="holding, input, coil or discrete.")]
Kind = Annotated[str, typer.Option("--type", help="u16, i16, u32, i32, u64, i64, f32, f64 or string.")]
Order = Annotated[str, typer.Option("--word-order", help="big (high word first) or little.")]
Seconds = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option(min=0.0, help="Read again and again, with so many seconds between."),
]
write_app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def read(
    address: Address,
    register: Register,
    count: Annotated[int, typer.Argument(min=1, help="How many values.")] = 1,
    table: Table = "holding",
    kind: Kind = "u16",
    word_order: Order = "big",
    every: Seconds = None,
    port: Port = None,
    baudrate: AxisBaudrate = None,
    plant: Plant = None,
    bus: BusName = None,
    sim: Sim = False,
    json: Json = False,
) -> None:
    """Read registers or coils of any Modbus device, with types."""
    from rs485bus.cli.process import start
    from rs485bus.cli.raw import What, parse_number, run_read

    what = What(
        address=address,
        register=parse_number(register, "register"),
        table=table,
        kind=kind,
        order=word_order,
        count=count,
    )
    what.check(writes=False)
    there = where(plant, port, baudrate, None, None, None, sim)
    start(lambda: run_read(there, bus, what, every, json))


@write_app.command(context_settings={"ignore_unknown_options": True})
def write(
    address: Address,
    register: Register,
    values: Annotated[list[str], typer.Argument(help="Numbers, like 100, -5, 0x1F or 2.5; on or off for coils.")],
    table: Table = "holding",
    kind: Kind = "u16",
    word_order: Order = "big",
    multiple: Annotated[bool, typer.Option(help="Use function 16 (or 15) for a single one, too.")] = False,
    verify: Annotated[bool, typer.Option(help="Read back and repeat where no reply comes.")] = False,
    port: Port = None,
    baudrate: AxisBaudrate = None,
    plant: Plant = None,
    bus: BusName = None,
    sim: Sim = False,
) -> None:
    """Write registers or coils of any Modbus device, with types. It is sent once."""
    from rs485bus.cli.process import start
    from rs485bus.cli.raw import What, parse_number, run_write

    what = What(
        address=address,
        register=parse_number(register, "register"),
        table=table,
        kind=kind,
        order=word_order,
    )
    what.check(writes=True)
    there = where(plant, port, baudrate, None, None, None, sim)
    start(lambda: run_write(there, bus, what, values, multiple=multiple, verify=verify))
