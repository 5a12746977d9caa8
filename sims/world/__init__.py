"""The simulated truth: true screws, tool, spheres, scatter. Written apart from everything that it is to test."""

from sims.world.world import World

__all__ = ["World"]
