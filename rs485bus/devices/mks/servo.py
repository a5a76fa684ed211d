"""MKS SERVO28D/35D/42D/57D as an axis. Source: MKS RTU V1.0.9."""

from __future__ import annotations

from rs485bus.devices.mks.moves import MksMoves
from rs485bus.devices.mks.origin import MksOrigin
from rs485bus.devices.mks.questions import MksQuestions
from rs485bus.devices.mks.service import MksService


class MksServo(MksMoves, MksOrigin, MksService, MksQuestions):
    """An MKS SERVO drive and its motor.

    A drive that restarts counts from zero where it then stands, and says nothing of it. It is noticed by a jump of the
    position, by the enabling, and at zero by the homing status. What stands at zero and was not homed since it was
    switched on, but set to zero, shows no difference: `home()` where a restart must not go unnoticed.

    Args:
        bus: the bus it is on.
        address: 1..247.
        model: which drive; it limits the current, and only a 57D has outputs.
        mode: the work mode it is set to. It cannot be read; `set_mode` sets it. The bus moves it in the SR modes only.
        microsteps: what it is set to, 1..255. At others than 16, 32 and 64 the drive takes speeds for something else
            (7.1); that is compensated for.
        units_per_turn: positions are in units of this many to a turn of the motor; 1 for turns.
        reverse: whether positive is the other way round. Which way the shaft then turns is not promised.
        positive: the direction of 0xF6 and 0xFD in which the position of 0x31 grows. The manual's text and its
            examples disagree (3.1.1, 3.1.2); where `run` goes the other way than `move_to`, it is
            `MotionDirection.CW`.
        limits: lowest and highest position that may be gone to, in units.
        rpm: the speed of moves that name none.
        acceleration: the acceleration of moves that name none: 78.4..20000 rpm/s.
        tolerance: counts (1/16384 turn) by which a position may differ from its target.

    Raises:
        AddressInUse: there is a facade for this address already.
        LimitExceeded, ValueError: an argument is out of its range.
        TypeError: one is of a wrong type.
    """
