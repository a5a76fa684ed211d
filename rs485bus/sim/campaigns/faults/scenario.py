"""What an application does, as a function that is run again and again with something else going wrong."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rs485bus.sim.campaigns.faults.world import World

Play = Callable[["World"], Coroutine[Any, Any, None]]
Places = tuple[tuple[str, int], ...]
"""The drives of one bus: family and address of each."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One of them."""

    family: str
    name: str
    says: str
    buses: tuple[Places, ...]
    play: Play
    may_differ: frozenset[str]
    """Verbs of which nobody can know what became of them where a frame was lost: writes without a read-back."""
    short: bool
    """All pairs of two lost frames are tried on it, too."""


SCENARIOS: dict[str, dict[str, Scenario]] = {}
"""By family and name."""


def scenario(
    family: str, *buses: Places, may_differ: tuple[str, ...] = (), short: bool = False
) -> Callable[[Play], Play]:
    """Make a function a scenario. Its name is the scenario's, its docstring says what happens in it.

    Args:
        family: the one that it is of.
        buses: the drives of each bus; one drive of the family at address 1, where none is named.
        may_differ: as in `Scenario`.
        short: as in `Scenario`.
    """

    def add(play: Play) -> Play:
        name = play.__name__.replace("_", "-")
        says = (play.__doc__ or "").strip()
        places = buses or (((family, 1),),)
        SCENARIOS.setdefault(family, {})[name] = Scenario(
            family, name, says, places, play, frozenset(may_differ), short
        )
        return play

    return add
