"""For all tests: one thread of linear algebra, as on the command line: its matrices are small, workers share cores."""

import os

for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
