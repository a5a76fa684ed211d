"""What it costs to tell the state of twelve moving axes twenty times a second, and whether any is lost."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.service.drives import plant_file
from benchmarks.service.drives import running as running_drives
from benchmarks.service.mosquitto import running
from benchmarks.service.processes import cpu_seconds, memory, serving
from rs485bus.remote import connect
from rs485bus.service.schema import AxisReport

_BUSES, _DRIVES = 3, 4


@dataclass(slots=True)
class States:
    """What was measured."""

    axes: int
    seconds: float
    wanted: float
    """Times a second."""
    received: int = 0
    lost: int = 0
    ages: list[float] = field(default_factory=list)
    service: float = 0.0
    """Share of a core."""
    broker: float = 0.0
    memory: float = 0.0
    """MB of the service."""

    @property
    def rate(self) -> float:
        return self.received / self.axes / self.seconds

    @property
    def holds(self) -> bool:
        return self.lost == 0 and self.rate > 0.98 * self.wanted

    def __str__(self) -> str:
        ages = sorted(1000 * age for age in self.ages)
        return (
            f"{self.axes} axes that move, told {self.rate:.1f} times a second each for {self.seconds:.0f} s: lost "
            f"{self.lost} of {self.received}; age when they came in {ages[len(ages) // 2]:.1f} ms (median), "
            f"{ages[int(0.99 * len(ages))]:.1f} ms (99 %); CPU of the service {100 * self.service:.0f} % of a core, of "
            f"mosquitto {100 * self.broker:.1f} %; memory of the service {self.memory:.0f} MB"
        )


async def measure(folder: Path, seconds: float, rate: float = 20.0) -> States:
    """Let all axes run, and count what comes in."""
    with running(folder) as broker:
        async with running_drives(folder, _BUSES, _DRIVES) as drives:
            file = folder / "plant.toml"
            file.write_text(plant_file("cell", drives.ports, _DRIVES))
            async with (
                serving(file, broker.url, folder / "cell.sqlite", "--rate", str(rate)) as served,
                connect(broker.url, plant="cell", lease=5.0) as cell,
            ):
                for axis in cell.axes.values():
                    await axis.enable()
                    await axis.run(30)
                states = States(len(cell.axes), seconds, rate)
                last: dict[str, int] = {}

                def count(name: str, report: AxisReport) -> None:
                    states.received += 1
                    states.lost += max(0, report.n - last.get(name, report.n - 1) - 1)
                    last[name] = report.n
                    states.ages.append(cell.session.now() - report.at)

                before = cpu_seconds(served.pid), cpu_seconds(broker.pid)
                cell.session.on_state.append(count)
                await asyncio.sleep(seconds)
                cell.session.on_state.remove(count)
                states.service = (cpu_seconds(served.pid) - before[0]) / seconds
                states.broker = (cpu_seconds(broker.pid) - before[1]) / seconds
                states.memory = memory(served.pid)
                await cell.stop()
    return states
