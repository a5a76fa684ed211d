"""Property tests try the same examples every time, so that a red run can be had again; and no example is timed.

HYPOTHESIS_PROFILE=search pytest tries new ones, HYPOTHESIS_PROFILE=many 20,000 of them a test.
"""

import os

from hypothesis import HealthCheck, settings

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None)
settings.register_profile("many", max_examples=20_000, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))
