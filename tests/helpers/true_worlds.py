"""The world of the shipped sphere cell, with only those errors that a test switches on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sims.cell import ERRORS, read_cell
from sims.world import World

CELL = read_cell(Path(__file__).parents[2] / "procedures/cells/sphere_cell.yaml")
BENT = (10.0, -80.0, 85.0, 20.0, 40.0, 30.0)
"""Readings of a pose without any symmetry, deg."""


def with_errors(cell=CELL, **errors):
    """The cell in which only the named errors are on, as large as given."""
    return replace(cell, simulate=replace(cell.simulate, errors=dict.fromkeys(ERRORS, 0.0) | errors))


def world(seed=1, cell=CELL, **errors):
    """A world in which only the named errors are on."""
    return World(with_errors(cell, **errors), seed)
