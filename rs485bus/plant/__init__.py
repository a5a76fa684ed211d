"""The plant file: which buses, axes, groups and vehicle there are, so that programs and commands know them by name.

    async with Plant.load("plant.toml") as plant:
        await plant.x.home()

It needs the extra `plant` (pydantic and tomlkit).
"""

from rs485bus.errors import PlantFileError
from rs485bus.plant.families import families
from rs485bus.plant.family import Family
from rs485bus.plant.problems import Problem

try:
    from rs485bus.plant.entries import AxisEntry, BusEntry, GroupEntry, VehicleEntry
    from rs485bus.plant.file import PlantFile
    from rs485bus.plant.plant import Plant
except ModuleNotFoundError as missing:
    if missing.name is None or missing.name.split(".")[0] not in ("pydantic", "tomlkit", "pydantic_core"):
        raise
    raise ModuleNotFoundError(
        f'The plant file needs the package {missing.name}, which is not installed: pip install "rs485bus[plant]"',
        name=missing.name,
    ) from missing

__all__ = [
    "AxisEntry",
    "BusEntry",
    "Family",
    "GroupEntry",
    "Plant",
    "PlantFile",
    "PlantFileError",
    "Problem",
    "VehicleEntry",
    "families",
]
