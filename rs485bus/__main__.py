"""`python -m rs485bus` is the command `rs485bus`."""

from rs485bus.cli import main

main()
