"""The tracker: a laser station that speaks GeoCOM, on a serial line that is a pseudo-terminal."""

from sims.geocom._description import SIMULATOR

__all__ = ["SIMULATOR"]
