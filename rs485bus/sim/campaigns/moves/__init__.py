"""Relative moves on a line that loses frames: every shaft must stand where the sum of its acknowledged moves says.

python -m rs485bus.sim.relative_moves --moves 100000

The same plant and the same moves are carried out twice: through this package, and by a script on pymodbus' own client
with its defaults.
"""
