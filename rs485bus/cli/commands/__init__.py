"""Which commands there are. A command's module is loaded when that command is run, or its help is shown.

To add one: write a function (or a `typer.Typer` with sub-commands) in a file of its own in this folder, and add a line
here. Such a file imports nothing but typer and `rs485bus.cli.options` at its top, so that its help comes at once; what
does the work is imported in the function, and run by `rs485bus.cli.process.start`.
"""

from __future__ import annotations

from typing import NamedTuple

FIND, MOVE, WATCH, PLAN, TRY = "Find and set up", "Move", "Watch and explain", "Plan and prove", "Without hardware"
PANELS = (FIND, MOVE, WATCH, PLAN, TRY)


class LazyCommand(NamedTuple):
    """Where a command is, and the line that the list of commands shows of it."""

    where: str
    """The module and the name in it of a function or of a `typer.Typer`: "rs485bus.cli.scan:scan"."""
    summary: str
    """The same as the first line of its docstring."""
    panel: str


COMMANDS: dict[str, LazyCommand] = {
    "axis": LazyCommand(
        "rs485bus.cli.commands.axis:app", "Have one axis do one thing, and wait until it is done.", MOVE
    ),
    "group": LazyCommand(
        "rs485bus.cli.commands.group:app",
        "Have the axes of a group do one thing together: they start together and arrive together.",
        MOVE,
    ),
    "estop": LazyCommand(
        "rs485bus.cli.commands.estop:estop",
        "Stop every drive as fast as it can, and say which were seen to stand.",
        MOVE,
    ),
    "guide": LazyCommand("rs485bus.cli.commands.guide:guide", "Show a page of the guide, or list the pages.", TRY),
    "jog": LazyCommand(
        "rs485bus.cli.commands.jog:jog",
        "Turn an axis while a key is held: arrows or a and d turn it, up and down change the speed, q ends it.",
        MOVE,
    ),
    "setup": LazyCommand(
        "rs485bus.cli.commands.setup:setup",
        "Give a new drive, alone on the pair, its address and its baud rate.",
        FIND,
    ),
    "settings": LazyCommand(
        "rs485bus.cli.commands.settings:app", "Read, write, save, load and compare what a drive is set to.", FIND
    ),
    "read": LazyCommand(
        "rs485bus.cli.commands.raw:read", "Read registers or coils of any Modbus device, with types.", FIND
    ),
    "write": LazyCommand(
        "rs485bus.cli.commands.raw:write_app",
        "Write registers or coils of any Modbus device, with types. It is sent once.",
        FIND,
    ),
    "ports": LazyCommand(
        "rs485bus.cli.commands.ports:ports",
        "List the serial ports: what is plugged in, who holds it, and what slows it down.",
        FIND,
    ),
    "scan": LazyCommand(
        "rs485bus.cli.commands.scan:scan",
        "Find the drives on a pair: at which addresses and rates somebody answers, and of which family.",
        FIND,
    ),
    "check": LazyCommand(
        "rs485bus.cli.commands.check:check", "Say whether a plant file is right, and what to mend.", PLAN
    ),
    "demo": LazyCommand(
        "rs485bus.cli.commands.demo:demo",
        "Home some drives, move them, watch them, stop: on a virtual plant, or on real drives.",
        TRY,
    ),
    "serve": LazyCommand(
        "rs485bus.cli.commands.serve:serve",
        "Serve a plant over an MQTT 5 broker, for other programs and other hosts, until interrupted.",
        MOVE,
    ),
    "explain": LazyCommand(
        "rs485bus.cli.commands.captures:explain",
        "Say what a capture holds: each frame in words, errors marked, statistics.",
        WATCH,
    ),
    "monitor": LazyCommand(
        "rs485bus.cli.commands.watch:monitor",
        "Show axes and bus live, with keys to stop one, to stop all, and to hold the view.",
        WATCH,
    ),
    "record": LazyCommand(
        "rs485bus.cli.commands.watch:record",
        "Ask the axes again and again, and keep what happens on the pair in a capture file.",
        WATCH,
    ),
    "plan": LazyCommand(
        "rs485bus.cli.commands.plan:plan",
        "Reckon what a plant asks of its pairs: rates, load, waits, margins, and what still fits.",
        PLAN,
    ),
    "pcap": LazyCommand(
        "rs485bus.cli.commands.captures:pcap",
        "Turn a capture into a file that Wireshark shows as Modbus RTU.",
        WATCH,
    ),
    "plot": LazyCommand(
        "rs485bus.cli.commands.captures:plot",
        "Draw a capture: a lane for each unit, latency, load, and what the axes did.",
        WATCH,
    ),
    "sniff": LazyCommand(
        "rs485bus.cli.commands.sniff:sniff",
        "Listen to a pair that another master owns: frames in words, drives recognised, errors marked.",
        WATCH,
    ),
    "sim": LazyCommand(
        "rs485bus.cli.commands.sim:sim",
        "Put virtual drives on a pseudo-terminal, for any Modbus master, until interrupted.",
        TRY,
    ),
    "tune": LazyCommand(
        "rs485bus.cli.commands.tune:tune",
        "Find each drive's reply time, the shortest silence and the highest rate at which nothing is lost.",
        PLAN,
    ),
    "verify": LazyCommand(
        "rs485bus.cli.commands.verify:verify",
        "Try on real drives what their manuals leave open: the answers as options, and as a report. It turns motors.",
        PLAN,
    ),
    "verify-watchdog": LazyCommand(
        "rs485bus.cli.commands.verify_watchdog:verify_watchdog",
        "Find out on the bench what feeds a drive's watchdog, and whether a trip latches. It turns the motor.",
        PLAN,
    ),
}
