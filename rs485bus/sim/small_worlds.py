"""The command `python -m rs485bus.sim.small_worlds`. What it does stands in `rs485bus.sim.campaigns.small`."""

import sys

from rs485bus.sim.campaigns.small.explore import main

if __name__ == "__main__":
    sys.exit(main())
