"""Prior and posterior of the tests' own arm, and SciPy's optimum of it by finite differences."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from tests.helpers.own_model import Floats, OwnArm, six_of, turns
from tests.helpers.own_rows import OwnRows


@dataclass(frozen=True)
class OwnPrior:
    """1 σ of each kind of parameter about the table; flat: of what nothing is known, mm and rad."""

    link_mm: float = 0.5
    angle_deg: float = 0.05
    joint_zero_deg: float = 0.05
    tool_mm: float = 2.0
    deflection: float = 0.002
    flat_mm: float = 1000.0
    flat_rad: float = 1.0

    def sigma(self, name: str, flat: Sequence[str]) -> float:
        """1 σ of a parameter; flat where its name begins with one of `flat`."""
        if name.startswith(tuple(flat)):
            return self.flat_rad if turns(name) else self.flat_mm
        if name == "tool_deflection":
            return self.deflection
        if re.fullmatch(r"theta\d+", name):
            return float(np.radians(self.joint_zero_deg))
        if turns(name):
            return float(np.radians(self.angle_deg))
        return self.tool_mm if name.startswith("tool_") else self.link_mm


@dataclass(frozen=True, eq=False)
class Unknown:
    """Names (F,) of what is free, prior σ (F,), and the arm and centres (S, 3) from which deviations count."""

    names: tuple[str, ...]
    sigma: Floats
    start: OwnArm
    centres: Floats

    def arm(self, deviations: Floats) -> OwnArm:
        """The arm at `deviations` (F,)."""
        return self.start.moved(self.names, deviations)

    def centres_at(self, deviations: Floats) -> Floats:
        """The spheres' centres (S, 3) at `deviations` (F,): the last of them."""
        return self.centres + deviations[len(deviations) - self.centres.size :].reshape(-1, 3)

    def columns(self, deviations: Floats, q: Floats) -> Floats:
        """How the tool centre points at angles q (N, n) move with the deviations (N, 3, F), by central differences."""
        steps = np.diag([1e-6 if turns(name) else 1e-4 for name in self.names])
        ahead, behind = ([self.arm(deviations + side * step).points(q) for step in steps] for side in (1.0, -1.0))
        return np.asarray(
            np.moveaxis((np.array(ahead) - np.array(behind)) / (2.0 * np.diag(steps))[:, None, None], 0, -1)
        )


def scipys_optimum(unknown: Unknown, rows: OwnRows) -> Floats:
    """Most probable deviations (F,): least squares of misfit and prior, derivatives by SciPy's own differences."""

    def residual(scaled: Floats) -> Floats:
        deviations = scaled * unknown.sigma
        return np.concatenate([rows.misfit(unknown.arm(deviations), unknown.centres_at(deviations)), scaled])

    start = np.zeros(len(unknown.names))
    found = least_squares(residual, start, jac="2-point", method="lm", xtol=1e-10, ftol=1e-12)
    return np.asarray(found.x * unknown.sigma)


def deviations_between(names: Sequence[str], start: OwnArm, arm: OwnArm, start_at: Floats, centres: Floats) -> Floats:
    """By how much (F,) `arm` and `centres` (S, 3) deviate from `start` and `start_at`, named parameters only."""
    frames = {
        "base": six_of(np.linalg.inv(start.base) @ arm.base),
        "tool": six_of(np.linalg.inv(start.tool) @ arm.tool),
    }
    values = dict(zip(start.link_names, _entries(arm) - _entries(start), strict=True))
    values |= {f"{frame}_{letter}": six[i] for frame, six in frames.items() for i, letter in enumerate("xyzabc")}
    values["tool_deflection"] = arm.bend - start.bend
    away = centres - start_at
    values |= {f"S{s + 1}_{axis}": row[i] for s, row in enumerate(away) for i, axis in enumerate("xyz")}
    return np.array([0.0 if name.startswith("discrepancy") else values[name] for name in names])


def _entries(arm: OwnArm) -> Floats:
    columns = ("theta", "d", "a", "alpha", "beta")
    places = [re.fullmatch(r"(\D+)(\d+)", name) for name in arm.link_names]
    return np.array([arm.table[int(place[2]) - 1, columns.index(place[1])] for place in places if place])
