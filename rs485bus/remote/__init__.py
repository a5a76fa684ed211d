"""Plants that are served over a broker, used from anywhere with the verbs of `rs485bus`.

    async with remote.connect("mqtt://host", plant="cell") as plant:
        await plant.x.move_to(3)

It needs the extra `service` (aiomqtt).
"""

from rs485bus.remote.axis import RemoteAxis, RemoteGroup, RemoteVehicle
from rs485bus.remote.formation import Formation, FormationMove
from rs485bus.remote.handles import RemoteMove
from rs485bus.remote.plant import RemotePlant, connect
from rs485bus.remote.stream import RemoteStream
from rs485bus.service.broker import Broker

__all__ = [
    "Broker",
    "Formation",
    "FormationMove",
    "RemoteAxis",
    "RemoteGroup",
    "RemoteMove",
    "RemotePlant",
    "RemoteStream",
    "RemoteVehicle",
    "connect",
]
