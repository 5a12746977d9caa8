"""The drives of the arm on a CAN bus: one CiA 402 drive per axis, as CANopen nodes."""

from sims.drives._description import SIMULATOR

__all__ = ["SIMULATOR"]
