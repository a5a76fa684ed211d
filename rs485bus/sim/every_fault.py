"""The command `python -m rs485bus.sim.every_fault`. What it does stands in `rs485bus.sim.campaigns.faults`."""

import sys

from rs485bus.sim.campaigns.faults.campaign import main

if __name__ == "__main__":
    sys.exit(main())
