"""Every exception, each saying what happened, to whom, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


class BusError(Exception):
    """The base of everything this package raises on purpose."""


# The port


class PortError(BusError):
    """A port could not be opened, or was lost. The message says what to do."""


class PortNotFound(PortError):
    """There is no such port."""


class PortPermissionDenied(PortError):
    """The port exists, but this user may not open it."""


class PortBusy(PortError):
    """Somebody else holds the port."""


# Using the bus wrongly: nothing was sent


class AddressInUse(BusError):
    """A second facade was made for an address that has one."""


class BroadcastConflict(BusError, ValueError):
    """A broadcast is a read, or would be acted on by a family that it was not meant for. Nothing was sent."""


class LimitExceeded(BusError, ValueError):
    """A value lies outside what the axis, its limits or its register can hold. It was not done.

    Where that depends on where the axis stands, or on what its drive is set to, the drive was asked before.
    """


class NotSupported(BusError):
    """The drive cannot do this. The message says what to do instead."""


class WatchdogInfeasible(BusError):
    """The devices cannot all be fed in time on this line. Nothing was armed.

    `numbers` holds what was added up, in seconds.
    """

    def __init__(self, message: str, numbers: Mapping[str, float] | None = None) -> None:
        super().__init__(message)
        self.numbers = dict(numbers or {})


class WatchdogInUse(BusError):
    """A device is guarded by a watchdog block already."""


class NotGuarding(BusError, RuntimeError):
    """A watchdog block was told to renew its lease before it was entered, or after it was left."""


class WrongThread(BusError, RuntimeError):
    """The bus was called from another thread than the one its event loop runs in."""


class LoopNotRunning(WrongThread):
    """The bus was called while its event loop does not run: between two cells of a plain IPython session, say."""


class PlantFileError(BusError, ValueError):
    """A plant file has mistakes. Nothing was opened.

    `problems` says of each where it is (line and field) and what to do about it.
    """

    def __init__(self, message: str, problems: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.problems = tuple(problems)


# What became of a request


class RequestFailed(BusError):
    """A request did not end in a reply.

    `address` is the unit asked, `request` the frame (empty if none was made), `attempts` how often it was sent,
    `code` the Modbus exception code that answered its last attempt; None if none did. `records` holds the latest
    transactions on the bus where they help to find out what happened.
    """

    def __init__(
        self,
        message: str,
        *,
        address: int = 0,
        request: bytes = b"",
        attempts: int = 0,
        code: int | None = None,
        records: Sequence[Any] = (),
    ) -> None:
        super().__init__(message)
        self.address = address
        self.request = request
        self.attempts = attempts
        self.code = code
        self.records = tuple(records)


class DeviceRefused(RequestFailed):
    """The device said no. It was not done; of a block, the message says, a part may have been written.

    `code` is None where the family refuses in a normal reply.
    """


class WatchdogNotSupported(DeviceRefused, NotSupported):
    """The drive refused to have its watchdog set: its firmware has none. Nothing was armed."""


class NotSent(RequestFailed):
    """The request never reached the wire: cancelled, flushed, expired, or the bus was closed. Nothing was done."""


class LineBusy(NotSent):
    """The line was never quiet, so that no frame could be sent. The message says what to look for."""


class QueueFull(NotSent):
    """Too many requests wait already."""


class DeviceOffline(NotSent):
    """The device has stopped answering; the bus looks for it by itself."""


class EmergencyStopped(NotSent):
    """The bus is latched by an emergency stop."""


class BusClosed(NotSent):
    """The bus was closed."""


class NoReply(RequestFailed):
    """It was sent and nothing fitting came back. It may be repeated safely."""


class OutcomeUnknown(RequestFailed):
    """It was sent, and nobody knows whether it was done: nothing fitting came back, or an exception that leaves it open
    (04, 05 and others), or a gateway gave the device up. It must not be repeated blindly: read back what was done."""


# What became of a motion


class MotionError(BusError):
    """A motion did not end as it was asked to."""


class MotionInterrupted(MotionError, NotSent):
    """The port was lost while something was under way. How far it went is not known; what is left of it is not sent.

    The axis is stopped as soon as the port is there again: then ask for its position.
    """


class MoveCancelled(MotionError):
    """The move was cancelled: by `cancel()`, by a stop, or because one before it failed."""


class MoveTimeout(MotionError):
    """The move took longer than twice what it should, plus a second. The axis was stopped."""


class MoveFailed(MotionError):
    """The motor stands, but not where it should. The message says what the drive reports."""


class MotorStalled(MoveFailed):
    """The drive reports that the shaft was blocked."""


class DriveFault(MoveFailed):
    """The drive reports an error of its own."""


class LimitReached(MoveFailed):
    """A limit has stopped the axis: a switch, a soft limit of the drive, or the axis' own `limits`."""


class HomingFailed(MoveFailed):
    """Homing ended without finding the origin."""


class ReferenceLost(MotionError):
    """The position changed in a way that cannot be explained (a restart, say). Home the axis or set its zero."""


class NotEnabled(MotionError):
    """The motor is not energised: `enable()` the axis first. A move that had begun has ended with it."""


class NotStanding(MotionError):
    """The motor turns, and must stand for this: `stop()` the axis first. What needs that was not sent."""


class RearmRequired(MotionError):
    """The axis was stopped for safety and moves only after `enable()`."""


class StopUnconfirmed(MotionError):
    """The axis was told to stop and could not be seen standing. Use the hard-wired emergency stop."""


# A plant that is served over a broker


class BrokerError(BusError):
    """The MQTT broker cannot be reached, refuses what was asked of it, or was lost. The message says what to do."""


class NotInControl(NotSent):
    """Who said it does not hold the lease of the axis, or holds it no more. Nothing was done."""


class RequestMalformed(BusError, ValueError):
    """A message to a served plant is not what its schema says. Nothing was done."""
