"""Whether the adapter returns what is sent: told by reads that were answered. Pure.

An adapter that echoes looks like a slave that agrees with every write whose reply repeats it. Nobody answers a read
with its own bytes: so they come back before the answer exactly if the adapter echoes. A read that is not answered
tells nothing, and neither does a frame that nobody answers, or one whose reply repeats it.
"""

from __future__ import annotations

from collections.abc import Iterable

TRIES = 3
"""Reads of one unit in vain, after which what is written to it waits no longer."""
_SURE = 2
"""Pieces of evidence that agree, where there was noise, or where they contradict what was found before."""


class EchoQuestion:
    """Finds out, and changes its mind.

    Args:
        verdict: whether the adapter echoes; None to find out.
    """

    __slots__ = ("_auto", "_contrary", "_noisy", "_tries", "is_in_doubt", "is_pressing", "verdict")

    def __init__(self, verdict: bool | None) -> None:
        self.verdict = verdict
        self.is_pressing = False
        """A read was in vain since it was asked last: other reads may be, too."""
        self.is_in_doubt = False
        """The latest evidence contradicts the verdict."""
        self._auto = verdict is None
        self._contrary = 0
        self._noisy = [0, 0]
        self._tries: dict[int, int] = {}

    @property
    def is_open(self) -> bool:
        """Whether it is still to be found out."""
        return self.verdict is None

    def judge(self, echoed: bool, clean: bool) -> None:
        """A read was answered.

        Args:
            echoed: its own bytes stood before the answer.
            clean: nothing else did.
        """
        if not self._auto:
            return
        if self.verdict is None:
            self._noisy[echoed] += 1
            if clean or self._noisy[echoed] >= _SURE:
                self._decide(echoed)
        elif echoed is self.verdict:
            self._contrary, self.is_in_doubt = 0, False
        else:
            self._contrary, self.is_in_doubt = self._contrary + 1, True
            if self._contrary >= _SURE:
                self._decide(echoed)

    def reopen(self) -> None:
        """Another adapter may be there now."""
        if self._auto:
            self._decide(None)

    def tried(self, address: int) -> None:
        """A read of a unit told nothing."""
        if self.verdict is None:
            self._tries[address] = self._tries.get(address, 0) + 1
            self.is_pressing = True

    def keeps_waiting(self, address: int) -> bool:
        """Whether what is written to a unit has to wait for the verdict."""
        return self.verdict is None and self._tries.get(address, 0) < TRIES

    def ask(self, addresses: Iterable[int]) -> int | None:
        """Which of some units to read next: the one tried least, so that one that is there is found soon."""
        waiting = [address for address in addresses if self.keeps_waiting(address)]
        self.is_pressing = False
        return min(waiting, key=lambda address: self._tries.get(address, 0), default=None)

    def _decide(self, verdict: bool | None) -> None:
        self.verdict = verdict
        self.is_pressing = self.is_in_doubt = False
        self._contrary = 0
        self._noisy = [0, 0]
        self._tries.clear()
