"""A dial gauge on a serial line."""
