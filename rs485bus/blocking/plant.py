"""A plant file in the blocking face."""

from __future__ import annotations

import os
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rs485bus.blocking.interrupts import blocks, calls, interrupts
from rs485bus.blocking.mirror import Face, face_class, register
from rs485bus.blocking.opened import Opened
from rs485bus.bus.watchdog.guarding import EmergencyReport
from rs485bus.plant import Plant as AsyncPlant
from rs485bus.plant import PlantFile

if TYPE_CHECKING:
    _PlantFace = Face
else:
    _PlantFace = face_class(AsyncPlant)


class Plant(_PlantFace):
    """The buses, axes, groups and the vehicle of a plant file, open while a block runs.

        with blocking.Plant.load("plant.toml") as plant:
            plant.x.home().wait()

    As `rs485bus.Plant` otherwise.

    Args:
        file: what it is.
        sim: put virtual drives on virtual lines instead of opening ports.
        watchdogs: guard the axes whose entries say so.
    """

    _opened: Opened | None

    def __init__(self, file: PlantFile, *, sim: bool = False, watchdogs: bool = True) -> None:
        self._opened = None
        self._source = None
        self._inner = AsyncPlant(file, sim=sim, watchdogs=watchdogs)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, sim: bool = False, watchdogs: bool = True) -> Plant:
        """Read a plant file. Arguments as for the class.

        Raises:
            PlantFileError: it has mistakes. The message says where, and what to do.
        """
        return cls(PlantFile.load(path), sim=sim, watchdogs=watchdogs)

    def emergency_stop(self) -> dict[str, EmergencyReport]:
        """Stop every drive on every bus at once. Returns the reports, by the names of the buses."""

        async def stop() -> dict[str, EmergencyReport]:
            return await self._inner.emergency_stop()  # type: ignore[no-any-return] # as its class says

        reports: dict[str, EmergencyReport] = self._loop.call(stop)
        return reports

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._answer(getattr(self._inner, name))

    def __enter__(self) -> Plant:
        calls.depth += 1
        try:
            opened = self._opened = Opened(self._inner)
            opened.axes += self._inner.axes.values()
            opened.held_by(self)
            self._adopt(self._inner, opened.loop, None)
        finally:
            calls.depth -= 1
            if calls.pressed and not calls.depth:
                self._undo()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        calls.depth += 1
        try:
            assert self._opened is not None
            self._opened.leave(kind, error, trace)
        finally:
            calls.depth -= 1
            if calls.pressed and not calls.depth:
                interrupts.take_effect()

    def _undo(self) -> None:
        """Close what was just opened, and raise what Ctrl-C raises."""
        try:
            interrupts.take_effect()
        except BaseException as error:
            if self._opened is not None:
                self._opened.leave(type(error), error, error.__traceback__)
            raise


register(AsyncPlant, Plant)
blocks.add(Plant.__exit__.__code__)
