"""Searches along A1 on the wires of the simulated controller, and the sphere in their way."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, degrees, hypot, radians, sin

import numpy as np

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
STEP_DEG = 0.004
"""Of A1 in a cycle: 1 deg/s."""

TOUCH_MM = 61.4 / 2 + 0.6
"""From the sphere's centre to that of the tip in contact."""


def cell_with_sphere(bench, beside_deg=0.25):
    """The cell with one sphere on the circle that the tool describes about A1, touched after so many degrees."""
    cell = bench().cell
    x, y, z = bench().world().true_tcp(HOME)
    radius, heading = hypot(x, y), degrees(atan2(y, x))
    chord_deg = 2 * degrees(np.arcsin(TOUCH_MM / (2 * radius)))
    towards = radians(heading - beside_deg - chord_deg)  # A1 turns the other way round the base's z
    sphere = replace(cell.artefact.spheres[0], centre=(radius * cos(towards), radius * sin(towards), z))
    return replace(cell, artefact=replace(cell.artefact, spheres=(sphere,), distances=()))


def search_until_contact(pc):
    """Go along A1 until the loop closes, and leave RSI; the last reply."""
    pc.rsi_on()
    for i in range(300):
        pc.cycles(1, (STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))
        if pc.changes:
            break
    return pc.finish((STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))
