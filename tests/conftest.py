"""Property tests try the same examples every time, so that a red run can be had again; and no example is timed.

HYPOTHESIS_PROFILE=search pytest tries new ones.
"""

import os

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))
