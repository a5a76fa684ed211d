"""The blocking face says what the asynchronous one says: names, signatures, docstrings, types."""

import inspect

import pytest

import rs485bus
from rs485bus import blocking
from rs485bus.blocking.mirror import face_class, offered
from tests.blocking import stub

CLASSES = ["AxisGroup", "DifferentialDrive", "GroupMove", "MksServo", "Move", "TlrStepper", "Zlac8015d"]


def test_the_stub_is_what_the_asynchronous_classes_make_of_it() -> None:
    made, untyped = stub.text()
    assert not untyped, f"annotate these where they are set in __init__: {', '.join(untyped)}"
    assert stub.STUB.read_text() == made, "run: python -m tests.blocking.stub"


@pytest.mark.parametrize("name", CLASSES)
def test_a_face_has_the_methods_signatures_and_docstrings_of_its_class(name: str) -> None:
    cls = getattr(rs485bus, name)
    face = getattr(blocking, name)
    for base in cls.__mro__:
        for member in offered(base) if base.__module__.startswith("rs485bus.") else ():
            theirs, ours = inspect.getattr_static(cls, member), inspect.getattr_static(face, member, None)
            if member == "wait" or not callable(theirs):
                continue
            assert ours is not None, member
            assert ours.__doc__ == theirs.__doc__
            assert inspect.signature(ours) == inspect.signature(theirs)
            assert not inspect.iscoroutinefunction(ours)


def test_a_face_is_made_once() -> None:
    assert blocking.MksServo is face_class(rs485bus.MksServo)
    assert issubclass(blocking.MksServo, blocking.Axis)


def test_what_is_no_name_of_the_package_is_none_of_the_face() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Servo'"):
        _ = blocking.Servo
