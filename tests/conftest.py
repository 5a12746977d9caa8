"""For all tests: one thread of linear algebra, as on the command line: its matrices are small, workers share cores.

Hypothesis tries the same examples in every run, and measures no time: what passes on one machine passes on a busy one.
To look for examples that nobody has tried yet: `pytest --hypothesis-profile explore`.
"""

import os

from hypothesis import HealthCheck, settings

for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

settings.register_profile("explore", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("repeat", settings.get_profile("explore"), derandomize=True, database=None)
settings.load_profile("repeat")
