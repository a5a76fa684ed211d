"""Four axes, logged 20 times a second to a CSV file, and plotted.

python examples/log_and_plot.py                      # virtual drives
python examples/log_and_plot.py --port /dev/ttyUSB0 --baudrate 115200 --csv log.csv --plot log.png
"""

import argparse
import csv
import sys
import tempfile
import time
from pathlib import Path

from rs485bus import blocking
from rs485bus.sim import SimMks, VirtualLine

EVERY = 0.05
FOR = 3.0


def log(port: str | VirtualLine, baudrate: int, path: Path) -> None:
    """Move four axes, and write where they are."""
    with blocking.open_bus(port, baudrate=baudrate) as bus, path.open("w", newline="") as file:
        group = bus.group(a=bus.mks(1), b=bus.mks(2), c=bus.mks(3), d=bus.mks(4))
        table = csv.writer(file)
        table.writerow(("seconds", *group.axes))
        group.enable().wait()
        group.move_to(a=2, b=4, c=-2, d=1, duration=0.8 * FOR)
        begun = time.monotonic()
        for tick in range(int(FOR / EVERY)):
            table.writerow((f"{time.monotonic() - begun:.3f}", *group.positions().values()))
            time.sleep(max(0.0, begun + (tick + 1) * EVERY - time.monotonic()))


def plot(path: Path, picture: Path) -> None:
    """Draw what was logged."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with path.open() as file:
        rows = list(csv.DictReader(file))
    for name in list(rows[0])[1:]:
        plt.plot([float(row["seconds"]) for row in rows], [float(row[name]) for row in rows], label=name)
    plt.xlabel("seconds")
    plt.ylabel("turns")
    plt.legend()
    plt.savefig(picture)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual drives")
    parser.add_argument("--baudrate", type=int, default=115200)
    parser.add_argument("--csv", type=Path, default=Path(tempfile.gettempdir()) / "rs485bus-log.csv")
    parser.add_argument("--plot", type=Path, help="a picture to make of it (needs matplotlib)")
    given = parser.parse_args()
    drives = VirtualLine(*(SimMks(address) for address in (1, 2, 3, 4)), baudrate=given.baudrate)
    log(given.port or drives, given.baudrate, given.csv)
    print(f"{len(given.csv.read_text().splitlines()) - 1} rows in {given.csv}")
    if given.plot is not None:
        plot(given.csv, given.plot)
        print(f"drawn in {given.plot}", file=sys.stdout)
