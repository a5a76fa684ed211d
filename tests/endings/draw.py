"""What may happen, drawn from anything that has `random`'s methods: a seed, or hypothesis."""

from __future__ import annotations

import random

from rs485bus.bus.schedule.job import Urgency
from tests.endings.cable import framed
from tests.endings.records import Setting, Step
from tests.endings.slaves import FORBIDDEN, Reaction


def setting(rng: random.Random) -> Setting:
    """What stands still during a run."""
    gateway = rng.random() < 0.2
    echo = "" if gateway or rng.random() < 0.6 else rng.choice(("full", "split", "damaged"))
    return Setting(
        baudrate=rng.choice((115_200, 38_400, 9600)),
        gateway=gateway,
        echo=echo,
        echo_config="auto" if rng.random() < 0.6 else bool(echo),
        latency=rng.choice((0.0, 0.0, 0.001, 0.016)),
        by_silence=rng.random() < 0.7,
        answers_broadcasts=rng.random() < 0.1,
        lying=rng.random() < 0.1,
        raising=rng.random() < 0.08,
    )


def steps(rng: random.Random, most: int = 40) -> list[Step]:
    """What happens, one after the other."""
    quiet = rng.random() < 0.3
    return [_step(rng, quiet) for _ in range(rng.randrange(1, most))]


def _pause(rng: random.Random) -> float:
    kind = rng.random()
    if kind < 0.5:
        return 0.0
    if kind < 0.8:
        return round(rng.uniform(0, 0.01), 5)
    if kind < 0.97:
        return round(rng.uniform(0, 0.3), 4)
    return round(rng.uniform(0, 8), 3)


def _step(rng: random.Random, quiet: bool) -> Step:
    kinds = _QUIET if quiet else _ALL
    name = rng.choice(kinds)
    return Step(_pause(rng), name, _ARGUMENTS[name](rng))


def _address(rng: random.Random) -> int:
    return rng.choice((10, 10, 10, 11, 11, 1, 2, 20))


def _real(rng: random.Random) -> int:
    return rng.choice((10, 10, 11, 12, 12, 1, 2))


def _plain(rng: random.Random) -> int:
    return rng.choice((10, 10, 10, 11, 11, 20))


def _register(rng: random.Random) -> int:
    return FORBIDDEN + 1 if rng.random() < 0.1 else rng.randrange(4)


def _timeout(rng: random.Random) -> float:
    return round(rng.uniform(0.001, 2), 3) if rng.random() < 0.3 else 0.0


def _read(rng: random.Random) -> tuple[object, ...]:
    urgency = rng.choice((Urgency.COMMAND, Urgency.COMMAND, Urgency.POLL, Urgency.STOP))
    return (_plain(rng), _register(rng), rng.randrange(1, 4), rng.random() < 0.5, int(urgency), _timeout(rng))


def _write(rng: random.Random) -> tuple[object, ...]:
    return (
        _plain(rng),
        _register(rng),
        rng.randrange(3),
        rng.random() < 0.4,
        rng.random() < 0.4,
        _timeout(rng),
        rng.random() < 0.3,
    )


def reaction(rng: random.Random) -> tuple[int, Reaction]:
    """How a slave meets its next request, and which slave."""
    kind = rng.choice(_REACTIONS)
    value, data = 0.0, b""
    if kind == "late":
        value = round(rng.uniform(0.01, 0.5), 4)
    elif kind in ("torn", "flip"):
        value = round(rng.random(), 3)
    elif kind == "exception":
        value = rng.choice((1, 2, 3, 4, 6, 6, 8))
    elif kind == "done, exception":
        value = rng.choice((4, 5, 10, 11))
    elif kind in ("before", "after"):
        data = rng.choice((b"\0", b"\xff", b"\0\0\0", bytes(rng.randrange(256) for _ in range(rng.randrange(1, 12)))))
    elif kind == "instead":
        data = foreign(rng)
    address = _real(rng)
    return (address, Reaction(kind, value, data, rng.choice((0, 0, 1, 3))))


def foreign(rng: random.Random) -> bytes:
    """Somebody else's frame: of an address that nobody asks, or of a length that nobody expects."""
    kind = rng.randrange(4)
    if kind == 0:
        return framed(bytes((33, rng.choice((3, 4)), 2, rng.randrange(256), rng.randrange(256))))
    if kind == 1:
        return framed(bytes((rng.choice((10, 11, 1, 2)), 3, 20)) + bytes(20))
    if kind == 2:
        return framed(bytes((33, 6, 0, 1, 0, 1)))
    return bytes(rng.randrange(256) for _ in range(rng.randrange(1, 20)))


def _noise(rng: random.Random) -> tuple[object, ...]:
    return (foreign(rng) if rng.random() < 0.5 else bytes(rng.randrange(256) for _ in range(rng.randrange(1, 8))),)


def _babble(rng: random.Random) -> tuple[object, ...]:
    low, high = rng.choice(((0.001, 0.001), (0.0005, 0.0016), (0.001, 0.006)))
    return (rng.choice((0.02, 0.2, 1.0, 3.0)), low, high)


_ARGUMENTS = {
    "verify": lambda rng: (rng.randrange(3), rng.randrange(2), _timeout(rng)),
    "read": _read,
    "write": _write,
    "setting": lambda rng: (rng.choice((1, 2)), rng.choice((0x92, 0xFD, 0x83)), 1),
    "move": lambda rng: (rng.choice((1, 2)), rng.choice((60, 600)), _timeout(rng)),
    "broadcast": lambda rng: (rng.randrange(4), rng.randrange(3)),
    "cancel": lambda rng: (rng.randrange(40),),
    "stop": lambda rng: (rng.choice((1, 2)), rng.random() < 0.5, rng.random() < 0.3),
    "emergency": lambda rng: (),
    "clear": lambda rng: (),
    "unplug": lambda rng: (),
    "plug": lambda rng: (),
    "close": lambda rng: (),
    "react": reaction,
    "die": lambda rng: (_real(rng), rng.choice((0.05, 0.5, 3.0, 1000.0))),
    "noise": _noise,
    "babble": _babble,
    "observe": lambda rng: (True,),
}
_QUIET = (
    ["read"] * 8
    + ["write"] * 6
    + ["react"] * 8
    + ["verify"] * 3
    + ["setting", "move", "move", "cancel", "broadcast", "stop"]
)
_ALL = (
    ["read"] * 8
    + ["write"] * 8
    + ["react"] * 8
    + ["setting"] * 2
    + ["verify"] * 3
    + ["move"] * 4
    + ["stop"] * 4
    + ["cancel"] * 4
    + ["broadcast", "broadcast", "noise", "noise", "die", "die", "babble", "unplug", "plug", "plug", "plug"]
    + ["emergency", "clear", "observe"]
)
_REACTIONS = (
    ["lost"] * 4
    + ["late"] * 5
    + ["ok", "deaf", "deaf", "torn", "double", "flip", "before", "after", "instead"]
    + ["exception", "exception", "done, exception"]
)
