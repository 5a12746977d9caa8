"""Correction models written by hand, for tests of the process that applies them."""

from __future__ import annotations

import math

AXES = 6
LINKS = ((675.0, 350.0, -90.0), (0.0, 1150.0, 0.0), (0.0, 41.0, 90.0), (1000.0, 0.0, 90.0), (0.0, 0.0, 90.0))
"""d, a, alpha of a heavy robot, joint by joint; the flange lies 240 mm along the last axis."""

Matrix = list[list[float]]


def wavy_model(size: float, fade_deg: float = 2.0, span_deg: float = 120.0) -> dict[str, list[float]]:
    """A robot with errors of links, weight, gears and field; size 1: some millimetres. Measured from −span to span."""
    links = [_step(*link) for link in LINKS]
    errors = [(0.3 * size, 0.4 * size, 0.03 * size), (0.0, -0.5 * size, 0.02 * size), *[(0.1 * size,) * 3] * 3]
    true = [_step(d + x, a + y, alpha + z / 3) for (d, a, alpha), (x, y, z) in zip(LINKS, errors, strict=True)]
    flange = _step(240.0, 0.0, 0.0)
    identity = _step(0.0, 0.0, 0.0)
    node = [0.1 * j - 0.2 for j in range(AXES)]
    return {
        "sign": [1.0] * AXES,
        "offset": [0.0] * AXES,
        "base": _flat(identity),
        "links": _all([identity, *links, flange]),
        "tool": _flat(_step(300.0, -200.0, 0.0)),
        "identified": _all([identity, *true, _step(540.0, -200.0 + 0.2 * size, 0.0)]),
        "identified_base": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "down": [0.0, 0.0, -1.0],
        "weight": [2e-4 * size] * (2 * AXES * AXES),
        "load": [1e-6 * size] * AXES,
        "load_place": [-50.0, 0.0, 200.0],
        "bend": [0.1 * size],
        "stretch": [0.0] * (AXES + 1),
        "wave_joint": [0.0, 1.0, 2.0],
        "wave_order": [1.0, 2.0, 17.0],
        "wave_sine": [2e-4 * size] * 3,
        "wave_cosine": [1e-4 * size] * 3,
        "node_place": node,
        "node_scale": [1.0] * AXES,
        "node_weight": [0.3 * size, -0.2 * size, 0.1 * size],
        "lower": [-span_deg] * AXES,
        "upper": [span_deg] * AXES,
        "fade": [fade_deg],
    }


def _step(d: float, a: float, alpha_deg: float) -> Matrix:
    """Tz(d) Tx(a) Rx(alpha)."""
    c, s = math.cos(math.radians(alpha_deg)), math.sin(math.radians(alpha_deg))
    return [[1.0, 0.0, 0.0, a], [0.0, c, -s, 0.0], [0.0, s, c, d], [0.0, 0.0, 0.0, 1.0]]


def _flat(matrix: Matrix) -> list[float]:
    return [value for row in matrix for value in row]


def _all(matrices: list[Matrix]) -> list[float]:
    return [value for matrix in matrices for value in _flat(matrix)]
