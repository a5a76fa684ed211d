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


_ROOTS = ("AxisGroup", "DifferentialDrive", "GroupMove", "MksServo", "Move", "TlrStepper", "Zlac8015d")
"""Classes whose faces have a name here, and so have those of their bases."""


def __getattr__(name: str) -> Any:
    """The blocking face of a class of the same name: `blocking.MksServo(bus, 1)`."""
    import rs485bus

    if name == "Plant":
        from rs485bus.blocking.plant import Plant

        return Plant
    if name in _ROOTS:
        return face_class(getattr(rs485bus, name))
    face = None if name.startswith("_") else face_named(name, [getattr(rs485bus, root) for root in _ROOTS])
    if face is None:
        raise AttributeError(f"module 'rs485bus.blocking' has no attribute {name!r}")
    return face


def __dir__() -> list[str]:
    return sorted([*(name for name in globals() if name.startswith("__")), *__all__, *_ROOTS, "Plant"])
