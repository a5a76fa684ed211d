"""The families of drives that a plant file and the commands know: those here, and those that other packages register.

A package registers its family by an entry point of the group `rs485bus.families` that names a `Family`, or a function
that returns one:

    [project.entry-points."rs485bus.families"]
    acme = "acme_drives.bench:FAMILY"
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points

from rs485bus.errors import BusError
from rs485bus.plant.builtin import BUILTIN
from rs485bus.plant.family import Family

GROUP = "rs485bus.families"


@cache
def families() -> Mapping[str, Family]:
    """All that are known, by name.

    Raises:
        BusError: another package registers what is none.
    """
    known = {family.name: family for family in BUILTIN}
    for entry in entry_points(group=GROUP):
        if entry.name in known:
            continue
        try:
            loaded = entry.load()
            family = loaded if isinstance(loaded, Family) else loaded()
        except Exception as error:
            raise BusError(
                f"the family {entry.name!r} of another package ({entry.value}) cannot be loaded: {error}. "
                "Update that package or uninstall it."
            ) from error
        if not isinstance(family, Family):
            raise BusError(f"the family {entry.name!r} of another package ({entry.value}) is no rs485bus.plant.Family")
        known[entry.name] = family
    return known
