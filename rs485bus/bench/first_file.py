"""The first plant file of what a scan has found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import tomlkit

from rs485bus.bench.scan import Found
from rs485bus.plant.families import families


def first_plant_file(port: str, found: Sequence[Found], name: str = "plant") -> str:
    """A plant file with an axis for each drive found, to be completed.

    One pair has one rate and one format: the drives at those of most are written, the others are named in a comment.
    """
    drives = [one for one in found if one.family is not None]
    settings = Counter((one.baudrate, one.format) for one in drives)
    (rate, form), _ = settings.most_common(1)[0]
    document = tomlkit.document()
    document.add(tomlkit.comment("Check it with: rs485bus check FILE. Try it without its drives with: --sim."))
    document.add("name", name)
    bus = tomlkit.table()
    bus.update({"port": port, "baudrate": rate})
    if form.parity != "N":
        bus["parity"] = form.parity
    if form.stopbits != 1:
        bus["stopbits"] = form.stopbits
    document["buses"] = tomlkit.table(is_super_table=True)
    document["buses"]["main"] = bus
    document["axes"] = axes = tomlkit.table(is_super_table=True)
    for one in drives:
        family = families()[one.family or ""]
        if (one.baudrate, one.format) != (rate, form):
            axes.add(
                tomlkit.comment(f"{family.title} {one.address} is at {one.baudrate} bit/s, {one.format}: set it up")
            )
            continue
        for side in family.sides or (None,):
            axis = tomlkit.table()
            axis.update({"bus": "main", "family": family.name, "address": one.address})
            if side is not None:
                axis["side"] = side
            if one.twins:
                axis.comment("two drives may have this address")
            axes[f"{family.name}{one.address}" + (f"_{side}" if side else "")] = axis
    return tomlkit.dumps(document)
