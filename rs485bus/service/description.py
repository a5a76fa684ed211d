"""What a served plant says of itself."""

from __future__ import annotations

import socket

from rs485bus import __version__
from rs485bus.service.machine import Machine
from rs485bus.service.schema import AxisFacts, Description


def offline(plant: str, session: str) -> Description:
    """The plant is not served any more."""
    return Description(status="offline", session=session, plant=plant)


def online(machine: Machine, session: str) -> Description:
    """The plant is served."""
    plant, names = machine.plant, machine.names
    buses = {id(bus): name for name, bus in plant.buses.items()}
    return Description(
        status="online",
        session=session,
        plant=plant.name,
        version=__version__,
        host=socket.gethostname(),
        axes={
            name: AxisFacts(
                family=axis.attached.family,
                bus=buses.get(id(axis.bus), ""),
                address=axis.attached.address,
                unit=machine.unit(name),
                units_per_turn=axis.units_per_turn,
                rpm=axis.rpm,
                acceleration=axis.acceleration,
                limits=axis.limits,
                verbs=sorted(machine.table(name)),
            )
            for name, axis in plant.axes.items()
        },
        groups={name: sorted(names[name]) for name in plant.groups},
        vehicles={name: sorted(axes) for name, axes in names.items() if name not in (*plant.axes, *plant.groups)},
        buses=sorted(plant.buses),
    )
