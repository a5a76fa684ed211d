"""The command `python -m rs485bus.sim.long_motion`. What it does stands in `rs485bus.sim.campaigns.faults.long`."""

import sys

from rs485bus.sim.campaigns.faults.long import main

if __name__ == "__main__":
    sys.exit(main())
