"""The command `python -m rs485bus.sim.endurance`. What it does stands in `rs485bus.sim.campaigns.endurance`."""

import sys

from rs485bus.sim.campaigns.endurance import Endurance, Verdict, main

__all__ = ["Endurance", "Verdict", "main"]

if __name__ == "__main__":
    sys.exit(main())
