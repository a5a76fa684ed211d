"""Small worlds, explored to the end: the owner of the wire, two units, a few jobs, and every order of what can happen.

    python -m rs485bus.sim.small_worlds --world stop --depth 11

A world is a state machine: from each state every action is tried, states that were seen before are not gone on from.
"""
