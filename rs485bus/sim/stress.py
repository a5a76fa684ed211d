"""The command `python -m rs485bus.sim.stress`. What it does stands in `rs485bus.sim.campaigns.stress`."""

import sys

from rs485bus.sim.campaigns.stress import deaths, main, slow, tight

__all__ = ["deaths", "main", "slow", "tight"]

if __name__ == "__main__":
    sys.exit(main())
