"""A three-joint arm in closed form, as a robot file says it and as it really is: for tests of the way from files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROBOT = """\
name: elbow arm
convention: mdh-hayati
links:
  - {theta: 0, d: 400, a: 0, alpha: 90}
  - {theta: 0, a: 500, alpha: 0, beta: 0}
  - {theta: 0, d: 0, a: 450, alpha: 0}
joints:
  - {sign: 1, offset: 0, min: -180, max: 180, max_speed: 100}
  - {sign: -1, offset: 10, min: -180, max: 180, max_speed: 100}
  - {sign: 1, offset: 0, min: -180, max: 180, max_speed: 100}
repeatability: 0.02
"""
"""The second joint counts downwards from 10° above the horizontal."""

LOWER, UPPER = np.array([-90.0, -70.0, -120.0]), np.array([90.0, 0.0, -30.0])


@dataclass(frozen=True)
class ElbowArm:
    """The arm as it is. Lengths in mm at 20 °C; zero_deg: the elbow's error; growth: of all lengths, 1/K; play_deg: by
    which the shoulder stays behind where it moves upwards, and ahead where it moves downwards; tool: beyond the tip
    along the forearm, up from it, and to its right, mm. turn_deg, at: where the arm stands in the instrument's frame.
    lost_deg: by how much less each joint reads than it did before a crash.
    """

    upper: float = 500.8
    fore: float = 449.3
    zero_deg: float = 0.03
    growth: float = 0.0
    play_deg: float = 0.0
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0
    at: tuple[float, float, float] = (1000.0, 20.0, -30.0)
    lost_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def tcp(self, readings: Floats, celsius: Floats | float = 20.0, upwards: Floats | float = 0.0) -> Floats:
        """The tip (N, 3), mm, in the instrument's frame, at readings (N, 3), deg; upwards (N,): 1, -1 or 0."""
        read = readings + np.array(self.lost_deg)
        turn, shoulder = np.radians(read[:, 0]), np.radians(10.0 - read[:, 1] - self.play_deg * upwards)
        elbow = shoulder + np.radians(read[:, 2] + self.zero_deg)
        grown = 1.0 + self.growth * (celsius - 20.0)
        along, up, right = self.tool
        out = grown * (self.upper * np.cos(shoulder) + self.fore * np.cos(elbow))
        out = out + along * np.cos(elbow) - up * np.sin(elbow)
        height = grown * (400.0 + self.upper * np.sin(shoulder) + self.fore * np.sin(elbow))
        height = height + along * np.sin(elbow) + up * np.cos(elbow)
        x, y = out * np.cos(turn) + right * np.sin(turn), out * np.sin(turn) - right * np.cos(turn)
        c, s = np.cos(np.radians(self.turn_deg)), np.sin(np.radians(self.turn_deg))
        return np.stack([c * x - s * y, s * x + c * y, height], axis=1) + np.array(self.at)

    def reaching(self, points: Floats, rng: np.random.Generator) -> Floats:
        """Readings (N, 3) that put the tip at `points` (N, 3) (Newton)."""
        q = np.tile((LOWER + UPPER) / 2.0, (len(points), 1)) + rng.uniform(-5.0, 5.0, (len(points), 3))
        for _ in range(60):
            sides = [(self.tcp(q + h) - self.tcp(q - h)) / 2e-4 for h in 1e-4 * np.eye(3)]
            step = np.linalg.solve(np.stack(sides, axis=-1), (self.tcp(q) - points)[..., None])[..., 0]
            q = q - np.clip(step, -10.0, 10.0)
        return q


def drawn(rng: np.random.Generator, count: int) -> Floats:
    """Readings (count, 3), deg, all over the arm's region."""
    return rng.uniform(LOWER, UPPER, (count, 3))


def csv_text(columns: dict[str, object]) -> str:
    """A data set's text from columns, each a list of cells."""
    cells = [list(column) for column in columns.values()]  # type: ignore[call-overload]  # each is a sequence
    rows = [",".join(_cell(value) for value in row) for row in zip(*cells, strict=True)]
    return "\n".join([",".join(columns), *rows]) + "\n"


def joints_and_places(readings: Floats, places: Floats) -> dict[str, object]:
    """Columns A1, A2, A3, X, Y, Z."""
    return {**{f"A{j + 1}": readings[:, j] for j in range(3)}, **{n: places[:, i] for i, n in enumerate("XYZ")}}


def _cell(value: object) -> str:
    return value if isinstance(value, str) else repr(float(value))  # type: ignore[arg-type]  # numbers else
