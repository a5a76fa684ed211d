"""The same names and verbs for programs without `async`: scripts, notebooks, threads.

    from rs485bus import blocking

    with blocking.open_bus("/dev/ttyUSB0", baudrate=38400) as bus:
        x = bus.mks(1)
        x.enable()
        x.home()
        x.move_to(120).wait()

What commands acts when it is called and returns a handle, to `wait()` for or not. What asks returns the answer. What is
`async with` and `async for` elsewhere is `with` and `for` here.
"""

from typing import Any

from rs485bus.blocking.bus import Bus, open_bus
from rs485bus.blocking.mirror import face_class, face_named

__all__ = ["Bus", "open_bus"]


def __getattr__(name: str) -> Any:
    """The blocking face of a class of the same name: `blocking.MksServo(bus, 1)`."""
    import rs485bus

    if name.startswith("_"):
        raise AttributeError(f"module 'rs485bus.blocking' has no attribute {name!r}")
    offered = {offer: getattr(rs485bus, offer) for offer in rs485bus.__all__}
    if name in offered:
        return face_class(offered[name]) if isinstance(offered[name], type) else offered[name]
    face = face_named(name, [cls for cls in offered.values() if isinstance(cls, type)])
    if face is None:
        raise AttributeError(f"module 'rs485bus.blocking' has no attribute {name!r}")
    return face
