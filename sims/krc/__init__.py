"""The controller (KRC) in simulation: it moves the scene's arm; EKI server and RSI client, from the wire documents."""

from sims.krc._description import SIMULATOR

__all__ = ["SIMULATOR"]
