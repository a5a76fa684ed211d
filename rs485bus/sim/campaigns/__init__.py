"""Long runs of the real code in virtual time, each with a judge that knows what really happened.

python -m rs485bus.sim.campaign        a hostile line, a hundred thousand requests
python -m rs485bus.sim.endurance       31 guarded drives on a line that is never idle
python -m rs485bus.sim.stress          the tightest sets of watchdogs, dead drives, slow drives
python -m rs485bus.sim.every_fault     every fault at every frame of every scenario
"""
