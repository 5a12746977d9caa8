"""The controller of a UR arm: RTDE, Dashboard, primary, secondary and real-time interface, and URScript."""

from sims.ur._description import SIMULATOR

__all__ = ["SIMULATOR"]
