"""The command `python -m rs485bus.sim.campaign`. What it does stands in `rs485bus.sim.campaigns.campaign`."""

import sys

from rs485bus.sim.campaigns.campaign import ECHOING, HOSTILE, Campaign, kinds_of, main

__all__ = ["ECHOING", "HOSTILE", "Campaign", "kinds_of", "main"]

if __name__ == "__main__":
    sys.exit(main())
