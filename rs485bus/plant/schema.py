"""The JSON schema of plant files. It is made from the same sources as they are checked by."""

from __future__ import annotations

from typing import Any

from rs485bus.bus.config import BusConfig
from rs485bus.plant.entries import AxisEntry, BusEntry, GroupEntry, VehicleEntry
from rs485bus.plant.families import families
from rs485bus.plant.options import options_of, schema_of


def plant_schema() -> dict[str, Any]:
    """As `PlantFile.json_schema`."""
    axes = []
    for family in families().values():
        schema = schema_of(AxisEntry, options_of(family.facade(), family.by_side))
        low, high = family.addresses
        schema["title"] = family.title
        schema["properties"]["family"] = {"const": family.name}
        schema["properties"]["address"] |= {"minimum": low, "maximum": high}
        schema["required"] = ["family", "address"]
        if family.sides:
            schema["properties"]["side"] = {"enum": list(family.sides)}
            schema["required"].append("side")
        else:
            del schema["properties"]["side"]
        if family.watchdog is None:
            del schema["properties"]["watchdog"]
        axes.append(schema)
    vehicle = schema_of(VehicleEntry)
    vehicle["required"] = ["wheel_radius", "track"]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "rs485bus plant file",
        "type": "object",
        "required": ["buses", "axes"],
        "additionalProperties": False,
        "properties": {
            "name": {"type": "string"},
            "buses": {"type": "object", "additionalProperties": schema_of(BusEntry, options_of(BusConfig))},
            "axes": {"type": "object", "additionalProperties": {"anyOf": axes}},
            "groups": {"type": "object", "additionalProperties": schema_of(GroupEntry)},
            "vehicle": vehicle,
        },
    }
