"""The axes as RSI, EthernetKRL and the Ethernet configuration name them."""

AXES = 6
"""Axes in a telegram and in a correction, for every robot."""

AXIS_NAMES = tuple(f"A{i}" for i in range(1, AXES + 1))
