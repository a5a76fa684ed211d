"""What goes wrong at one frame of a scenario, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rs485bus.sim.treatment import PLAIN, Treatment

if TYPE_CHECKING:
    from rs485bus.sim.campaigns.faults.plant import Drive
    from rs485bus.sim.campaigns.faults.world import World

Act = Callable[["World", "Drive | None", float], "Treatment | None"]
"""Does something to a run when a frame is whole: to the drive that it is for, if there is one, at that time. It may say
what becomes of the frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing that goes wrong."""

    name: str
    says: str
    treatment: Treatment = PLAIN
    """What becomes of the frame."""
    act: Act | None = None
    """What happens besides, when the frame is whole."""
    harmless: bool = False
    """It must not change how any call ends."""
    only_for: frozenset[str] = frozenset({"mks", "zlac", "tlr"})
    """The families to which it can happen."""


def _drive(do: Callable[[Drive, float], None]) -> Act:
    def act(world: World, drive: Drive | None, now: float) -> None:
        if drive is not None:
            do(drive, now)

    return act


def _restart_after_reply(world: World, drive: Drive | None, now: float) -> Treatment | None:
    return None if drive is None else Treatment(after=lambda device, now: drive.restart(now))


def _all() -> Iterable[Fault]:
    # The line.
    yield Fault(name="request-lost", says="The drive never hears it.", treatment=Treatment(heard=False), harmless=True)
    yield Fault(
        name="reply-lost", says="It is done, and its reply is lost.", treatment=Treatment(answered=False), harmless=True
    )
    yield Fault(
        name="reply-late",
        says="Its reply comes 0.15 s late, when others are served already.",
        treatment=Treatment(delay=0.15),
        harmless=True,
    )
    yield Fault(
        name="reply-very-late",
        says="Its reply comes 0.4 s late, when it was asked for the last time.",
        treatment=Treatment(delay=0.4),
    )
    yield Fault(
        name="reply-a-bit-late",
        says="Its reply comes 30 ms late, when it was asked again, perhaps.",
        treatment=Treatment(delay=0.03),
        harmless=True,
    )
    yield Fault(name="reply-doubled", says="Its reply comes twice.", treatment=Treatment(copies=2), harmless=True)
    yield Fault(
        name="reply-damaged", says="A bit of its reply is inverted.", treatment=Treatment(damaged=True), harmless=True
    )
    yield Fault(name="reply-torn", says="Half of its reply arrives.", treatment=Treatment(torn=True), harmless=True)
    # What the drive or a gateway says.
    for code, done, says in (
        (4, False, "The drive has failed, it says, and did nothing."),
        (4, True, "The drive has failed, it says, and did it."),
        (5, True, "The drive is still at it, it says."),
        (6, False, "The drive is busy, it says, and did nothing."),
        (11, False, "A gateway says that nobody answered, and nobody heard it."),
        (11, True, "A gateway says that nobody answered, and it was done."),
    ):
        yield Fault(
            name=f"exception-{code:02x}" + ("-done" if done and code != 5 else ""),
            says=says,
            treatment=Treatment(code=code, carried_out=done),
            only_for=frozenset({"mks", "zlac"} if (code, done) == (4, True) else {"mks", "zlac", "tlr"}),
        )
    # The drive.
    yield Fault(
        name="restarted-before",
        says="The drive restarts before it hears it.",
        act=_drive(lambda drive, now: drive.restart(now)),
    )
    yield Fault(
        name="restarted-after",
        says="The drive restarts right after it has done it, its reply on the wire.",
        act=_restart_after_reply,
    )
    yield Fault(
        name="faulted", says="The drive has a fault and lets go.", act=_drive(lambda drive, now: drive.fault(now))
    )
    yield Fault(
        name="limit-hit",
        says="A limit switch closes; of a ZLAC, its emergency stop input.",
        act=_drive(lambda drive, now: drive.limit(now)),
    )
    yield Fault(name="stalled", says="The shaft is blocked.", act=_drive(lambda drive, now: drive.stall(now)))
    yield Fault(
        name="watchdog-tripped",
        says="The drive's watchdog stops it.",
        act=_drive(lambda drive, now: drive.trip(now)),
        only_for=frozenset({"mks", "zlac"}),
    )
    yield Fault(
        name="silent-for-a-while",
        says="From here on the drive hears nothing for 1.5 s.",
        act=lambda world, drive, now: world.deafen(drive, now, 1.5),
    )
    yield Fault(
        name="dead",
        says="The drive never hears anything again.",
        act=lambda world, drive, now: world.deafen(drive, now),
    )
    # The port and the computer.
    yield Fault(
        name="port-lost", says="The port is lost, and back after 0.4 s.", act=lambda world, _, now: world.unplug(0.4)
    )
    yield Fault(
        name="port-lost-for-long",
        says="The port is lost, and back after 4 s.",
        act=lambda world, _, now: world.unplug(4.0),
    )
    yield Fault(
        name="program-paused",
        says="The program does not run for 0.6 s.",
        act=lambda world, _, now: world.pause(0.6),
    )
    yield Fault(
        name="line-babbles",
        says="For 0.6 s there are bytes on the pairs that nobody sends.",
        act=lambda world, _, now: world.babble(0.6, 1.0),
    )
    yield Fault(
        name="line-babbles-with-gaps",
        says="For 2.5 s there are bytes on the pairs that nobody sends; every 50 ms they leave a gap.",
        act=lambda world, _, now: world.babble(2.5, 0.05),
    )
    # The application.
    yield Fault(
        name="caller-cancelled", says="The application is cancelled.", act=lambda world, _, now: world.cancel_caller()
    )
    yield Fault(
        name="second-caller-stops",
        says="Somebody else stops the axis.",
        act=lambda world, drive, now: world.second_caller("stop", drive),
    )
    yield Fault(
        name="emergency-stop",
        says="Somebody else makes an emergency stop of the bus.",
        act=lambda world, drive, now: world.second_caller("emergency_stop", None),
    )
    yield Fault(
        name="application-polls",
        says="From here on the application asks everything 20 times a second.",
        act=lambda world, _, now: world.poll(),
        harmless=True,
    )


FAULTS: dict[str, Fault] = {fault.name: fault for fault in _all()}
