"""The table of repeat rules, made from the registers of the families: what becomes of a write whose reply is lost."""

from __future__ import annotations

import importlib

from rs485bus.wire.registers import Block, Register, Repeat

_FAMILIES = {
    "MKS SERVO": "rs485bus.devices.mks.registers",
    "ZLAC8015D": "rs485bus.devices.zlac.registers",
    "TL-R": "rs485bus.devices.tlr.registers",
}
_RULES = {
    Repeat.SAFE: "is repeated: said twice it does the same",
    Repeat.VERIFY: "is read back, and repeated where that shows that it was not done",
    Repeat.NEVER: "is never repeated: what became of it is *unknown*, unless the drive shows it by another sign",
}
_HEAD = """# Repeat rules

What becomes of a write whose reply is lost. Reads are always repeated. Writes of your own, by `bus.unit(n)`, are never
repeated unless you say `repeat=`. The facades write like this; the tables are made from the registers themselves.
"""


def text() -> str:
    """The page, in Markdown."""
    parts = [_HEAD]
    for family, module in _FAMILIES.items():
        registers = importlib.import_module(module)
        parts.append(f"## {family}\n\n| a write of | rule |\n|---|---|")
        parts[-1] += "".join(
            f"\n| {', '.join(names)} | {_RULES[rule]} |" for rule in Repeat if (names := _written(registers, rule))
        )
        parts[-1] += "\n"
    return "\n".join(parts)


def _written(registers: object, rule: Repeat) -> list[str]:
    """The names of what is written by a rule, each once."""
    kinds = Register if rule is Repeat.SAFE else Register | Block  # blocks that are repeated are mostly read
    return sorted(
        {
            value.name
            for value in vars(registers).values()
            if isinstance(value, kinds) and value.repeat is rule and "w" in getattr(value, "access", "rw")
        }
    )
