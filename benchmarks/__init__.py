"""How near the bus comes to the limit of the wire, beside other libraries, on one paced line. `python -m benchmarks`."""
