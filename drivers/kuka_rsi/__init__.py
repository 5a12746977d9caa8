"""KUKA controller with RSI (searches, each interpolation cycle) and an EthernetKRL channel (point-to-point moves).

The cyclic process imports this module too: keep it free of imports.
"""

AXES = 6
"""Axes in a telegram and in a correction, for every robot."""

AXIS_NAMES = tuple(f"A{i}" for i in range(1, AXES + 1))
