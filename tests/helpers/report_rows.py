"""What every contact of a run records of its search."""

SEARCH = {
    "time_ns": 0,
    "time_sigma_ns": 0,
    "tick": 0,
    "bounces": 0,
    "stop_cycles": 2,
    "late": 0,
    "lost": 0,
    "skipped": 0,
    "attempt": 1,
}
