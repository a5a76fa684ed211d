"""What a plant will ask of its pairs, reckoned before a wire is laid. It needs the extra `plant`.

from rs485bus.planning import plan

for pair in plan(PlantFile.load("plant.toml")):
    print(pair.load_standing, pair.poll_rate, pair.stop_wait)
"""

from rs485bus.planning.frames import DriveTraffic, Frame
from rs485bus.planning.plan import PairPlan, plan

__all__ = ["DriveTraffic", "Frame", "PairPlan", "plan"]
