"""The guide: pages in Markdown, shown by `rs485bus guide`."""

from __future__ import annotations

from importlib.resources import files

TOPICS: dict[str, str] = {
    "first-motion": "from a bare computer to a motor that turns",
    "notebooks": "scripts, notebooks and threads: the bus without await",
    "wiring": "the pair, the port, and what to do where nothing answers",
    "bench": "find, set up, move, record and draw, from the shell",
    "calls": "which call for which need",
    "watchdogs": "what stops a motor when something is gone",
    "streams": "set-points: speeds that are told as they come: joysticks, paths, controllers",
    "groups": "axes that start and arrive together",
    "outcomes": "late replies, and what each error means",
    "other-devices": "plain Modbus beside the drives",
    "pymodbus": "drivers written for pymodbus",
    "testing": "your own machine in virtual time",
    "service": "a plant for other programs and hosts, over MQTT",
    "captures": "what happened on a pair: kept, explained, drawn",
    "performance": "what a pair can carry, and where the time goes",
    "manuals": "what the manuals leave open, and the options for it",
    "repeat-rules": "what becomes of a write whose reply is lost (made from the registers)",
    "architecture": "the house, and the ways of a request, of a move, of a stop",
    "new-family": "how a drive of another maker is added",
    "tried": "how long a new user took for four tasks, and where it stumbled",
    "contributing": "how to change it",
    "changelog": "what changed",
}
"""The pages, in the order in which one reads them."""


def topics() -> dict[str, str]:
    """The pages, each with what it is about: the listed ones, and behind them whatever else is in the folder."""
    others = sorted(entry.name.removesuffix(".md") for entry in files(__name__).iterdir() if entry.name.endswith(".md"))
    return {**TOPICS, **{name: "" for name in others if name not in TOPICS}}


def page(topic: str) -> str:
    """The text of a page, in Markdown.

    Raises:
        KeyError: there is none of that name.
    """
    if topic not in topics():
        raise KeyError(topic)
    if topic == "repeat-rules":
        from rs485bus.guide.repeat_rules import text

        return text()
    return (files(__name__) / f"{topic}.md").read_text(encoding="utf-8")
