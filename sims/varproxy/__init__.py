"""A KUKA controller behind a variable proxy (KUKAVARPROXY, C3 Bridge) in simulation: it moves the scene's arm."""

from sims.varproxy._description import SIMULATOR

__all__ = ["SIMULATOR"]
