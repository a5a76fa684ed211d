"""What drivers for older versions of pymodbus call: `slave=` or `unit=`, a count by its place, names of then."""

from __future__ import annotations

import functools
import inspect
import struct
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

from pymodbus.client.mixin import ModbusClientMixin

from rs485bus.compat.exchange import refused

C = TypeVar("C", bound=type)

_ID = "device_id"
_OLDER_IDS = ("slave", "unit")
_RENAMED = {
    "report_slave_id": "report_device_id",
    "diag_read_slave_message_count": "diag_read_device_message_count",
    "diag_read_slave_no_response_count": "diag_read_device_no_response_count",
    "diag_read_slave_nak_count": "diag_read_device_nak_count",
    "diag_read_slave_busy_count": "diag_read_device_busy_count",
}


def takes_older_calls(cls: C) -> C:
    """A class decorator: every request of pymodbus' client takes the arguments of older versions, too.

    They warn of their age. What pymodbus raises while it makes a request of wrong arguments becomes its own kind.
    """
    for name, method in inspect.getmembers(ModbusClientMixin, inspect.isfunction):
        if _ID in inspect.signature(method).parameters:
            setattr(cls, name, _translated(name, method))
    for older, name in _RENAMED.items():
        setattr(cls, older, _renamed(older, name))
    return cls


def _translated(name: str, method: Callable[..., Any]) -> Callable[..., Any]:
    parameters = list(inspect.signature(method).parameters.values())[1:]
    positional = [p.name for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
    by_name = [p.name for p in parameters if p.kind is p.KEYWORD_ONLY]

    @functools.wraps(method)
    def call(self: Any, *args: Any, **kwargs: Any) -> Any:
        if len(args) > len(positional):
            surplus = args[len(positional) :]
            if len(surplus) > len(by_name):
                raise TypeError(f"{name}() takes {len(positional) + len(by_name)} arguments, not {len(args)}")
            for key, value in zip(by_name, surplus, strict=False):
                if key in kwargs:
                    raise TypeError(f"{name}() got {key} twice")
                kwargs[key] = value
            _warn(f"{name}() takes {' and '.join(by_name[: len(surplus)])} by keyword")
            args = args[: len(positional)]
        for older in _OLDER_IDS:
            if older in kwargs:
                if _ID in kwargs:
                    raise TypeError(f"{name}() got {older}= and {_ID}=, which are the same")
                kwargs[_ID] = kwargs.pop(older)
                _warn(f"{older}= is called {_ID}=")
        try:
            return method(self, *args, **kwargs)
        except (ValueError, OverflowError, struct.error) as error:
            raise refused(error) from error

    return call


def _renamed(older: str, name: str) -> Callable[..., Any]:
    def call(self: Any, *args: Any, **kwargs: Any) -> Any:
        _warn(f"{older}() is called {name}()")
        return getattr(self, name)(*args, **kwargs)

    call.__name__ = older
    call.__doc__ = f"The older name of `{name}`."
    return call


def _warn(what: str) -> None:
    warnings.warn(f"{what} since pymodbus 3.10", DeprecationWarning, stacklevel=3)
