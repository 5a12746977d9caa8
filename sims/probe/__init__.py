"""The contact probe: a microcontroller that watches the loop, on a serial line that is a pseudo-terminal."""

from sims.probe._description import SIMULATOR

__all__ = ["SIMULATOR"]
