"""How near the bus and other libraries come to the limit of the wire, on one paced line: `python -m benchmarks`."""
