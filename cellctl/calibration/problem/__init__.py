"""The problem that a fit solves: task, start values, the region that a prior model was measured in."""
