"""The direction of an RS-485 transceiver, switched by the kernel (Linux)."""

from __future__ import annotations

import array
import sys

from serial.rs485 import RS485Settings

_TIOCGRS485, _TIOCSRS485 = 0x542E, 0x542F
_ENABLED, _RTS_ON_SEND, _RTS_AFTER_SEND, _RX_DURING_TX = 1 << 0, 1 << 1, 1 << 2, 1 << 4
_WORDS = 8
_FLAGS, _DELAY_BEFORE, _DELAY_AFTER = 0, 1, 2


def switch_direction(fd: int, settings: RS485Settings) -> None:
    """Have the kernel switch the direction of a port by RTS.

    Raises:
        OSError: its driver cannot.
    """
    if sys.platform != "linux":
        raise OSError(f"not supported on {sys.platform}")
    import fcntl

    config = array.array("I", [0] * _WORDS)
    fcntl.ioctl(fd, _TIOCGRS485, config)
    flags = _ENABLED
    flags |= _RTS_ON_SEND if settings.rts_level_for_tx else 0
    flags |= _RTS_AFTER_SEND if settings.rts_level_for_rx else 0
    flags |= _RX_DURING_TX if settings.loopback else 0
    config[_FLAGS] = (config[_FLAGS] & ~(_ENABLED | _RTS_ON_SEND | _RTS_AFTER_SEND | _RX_DURING_TX)) | flags
    config[_DELAY_BEFORE] = round(1000 * (settings.delay_before_tx or 0.0))
    config[_DELAY_AFTER] = round(1000 * (settings.delay_before_rx or 0.0))
    fcntl.ioctl(fd, _TIOCSRS485, config)
