"""What Home Assistant finds of a plant: states to look at, and stops. Nothing that moves."""

from __future__ import annotations

import json
from typing import Any

from rs485bus.service.schema import Description
from rs485bus.service.topics import Topics

PREFIX = "homeassistant"
_SENSORS: dict[str, tuple[str, str, dict[str, str]]] = {
    "position": ("sensor", "{{ value_json.position }}", {}),
    "speed": ("sensor", "{{ value_json.rpm }}", {"unit_of_measurement": "rpm"}),
    "moving": ("binary_sensor", "{{ 'ON' if value_json.moving else 'OFF' }}", {"device_class": "moving"}),
    "fault": ("binary_sensor", "{{ 'ON' if value_json.fault else 'OFF' }}", {"device_class": "problem"}),
}


def entries(topics: Topics, plant: Description) -> dict[str, bytes]:
    """What is published, retained, by topic."""
    found: dict[str, bytes] = {}
    availability = {
        "availability_topic": topics.service,
        "availability_template": "{{ value_json.status }}",
    }
    device = {
        "identifiers": [f"rs485bus-{plant.plant}"],
        "name": plant.plant,
        "manufacturer": "rs485bus",
        "sw_version": plant.version,
    }

    def add(kind: str, name: str, what: dict[str, Any]) -> None:
        entity = f"{plant.plant}_{name}".replace(".", "_")
        found[f"{PREFIX}/{kind}/{entity}/config"] = json.dumps(
            {"unique_id": f"rs485bus_{entity}", "object_id": entity, "device": device, **availability, **what}
        ).encode()

    for axis in plant.axes:
        for name, (kind, template, more) in _SENSORS.items():
            state = {"name": f"{axis} {name}", "state_topic": topics.axis(axis, "state"), "value_template": template}
            add(kind, f"{axis}_{name}", state | more)
        stop = {"v": 1, "id": "home-assistant", "client": "home-assistant", "axes": [axis]}
        add(
            "button",
            f"{axis}_stop",
            {"name": f"stop {axis}", "command_topic": topics.stop, "payload_press": json.dumps(stop), "qos": 1},
        )
    for name, topic in (("stop", topics.stop), ("emergency_stop", topics.emergency_stop)):
        everything = {"v": 1, "id": "home-assistant", "client": "home-assistant"}
        press = {"command_topic": topic, "payload_press": json.dumps(everything), "qos": 1}
        add("button", name, {"name": f"{name.replace('_', ' ')} {plant.plant}", **press})
    return found
