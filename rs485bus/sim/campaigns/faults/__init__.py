"""Every fault at every frame of every scenario, judged by what really happened (`python -m rs485bus.sim.every_fault`).

scenario  what an application does           scenarios/
plant     the virtual drives and options     plant.py
fault     what goes wrong at one frame       fault.py
recorder  what the application was told      recorder.py
evidence  all that is known of one run       evidence.py
oracle    the invariants                     oracle.py
"""
