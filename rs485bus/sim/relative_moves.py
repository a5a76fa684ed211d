"""The command `python -m rs485bus.sim.relative_moves`. What it does stands in `rs485bus.sim.campaigns.moves`."""

import sys

from rs485bus.sim.campaigns.moves.compare import main

if __name__ == "__main__":
    sys.exit(main())
