"""Prediction of an identified robot's TCP: shared by `cellctl predict` and `Model.predict`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cellctl.calibration import Frame, Postures
from cellctl.files import InputError, Problem
from cellctl.formats import DataSet, ModelFile
from cellctl.formats.dataset import Sieve, joint_readings, text_of
from cellctl.formats.measurements import Conditions
from cellctl.kinematics import Bools, Floats, abc_from_rotation

FRAMES: tuple[Frame, ...] = ("base", "points")


@final
@dataclass(frozen=True, eq=False)
class Predicted:
    """Predicted TCPs at N readings.

    readings (N, n), deg. poses (N, 4, 4), mm, in the model's frame. sigma_mm (N,): 1 σ, 3-D, NaN of a model that
    states none; sigma_among_mm (N,): of the TCPs relative to each other, None for fewer than four. radius_95: 95 %
    radius of a place over its σ (`MeasuredRegion`). inside (N,): within the measured region. assumed: conditions that
    the model needs and the rows do not state, one sentence each.
    """

    readings: Floats
    poses: Floats
    sigma_mm: Floats
    sigma_among_mm: Floats | None
    radius_95: float
    inside: Bools
    assumed: tuple[str, ...]

    def records(self) -> list[dict[str, Any]]:
        """The rows of `cellctl predict`: A1…An, X, Y, Z, A, B, C, sigma, sigma_among, seen."""
        turns = abc_from_rotation(self.poses[:, :3, :3])
        values = np.column_stack([self.readings, self.poses[:, :3, 3], turns])
        joints = (f"A{number}" for number in range(1, self.readings.shape[1] + 1))
        names = [*joints, "X", "Y", "Z", "A", "B", "C"]
        sigma, among = _cells(self.sigma_mm, len(values)), _cells(self.sigma_among_mm, len(values))
        return [
            {**dict(zip(names, row, strict=True)), "sigma": of_row, "sigma_among": own, "seen": int(inside)}
            for row, of_row, own, inside in zip(np.round(values, 9).tolist(), sigma, among, self.inside, strict=True)
        ]

    def text(self) -> str:
        """The records as CSV."""
        return text_of(self.records())


def predict_rows(model: ModelFile, data: DataSet, *, frame: str = "base") -> Predicted:
    """The TCP at the joints and conditions of each row; frame: of σ, as in `ModelFile.sigma`.

    Raises InputError with every row that cannot be used: leaving some out would shift the others' lines.
    """
    chosen = next((each for each in FRAMES if each == frame), None)
    if chosen is None:
        raise InputError(Problem("--frame", 0, 0, f"'{frame}' is not known", f"one of: {', '.join(FRAMES)}"))
    sieve = Sieve(data)
    readings = joint_readings(sieve, model.robot)
    conditions = Conditions(sieve, model.robot, readings)
    if sieve.rejected():
        raise InputError(Problem(data.file, row.line, 0, row.reason) for row in sieve.rejected())
    _refuse_radians(model, data, readings)
    at = conditions.at(range(len(readings)))
    if refused := list(model.load_region.refused(at) if model.load_region else ()):
        raise InputError(Problem(data.file, data.lines[row], 0, reason, cure) for row, reason, cure in refused)
    found = model.predict(readings, at, frame=chosen)
    return Predicted(
        readings,
        found.poses,
        found.sigma_mm,
        model.sigma(readings, at, kind="among") if len(readings) >= 4 else None,
        model.radius_95,
        model.inside(readings),
        _assumed(model, at),
    )


def _refuse_radians(model: ModelFile, data: DataSet, readings: Floats) -> None:
    """Raise InputError where all readings, deg, are outside the measured region, and all would be inside as radians."""
    slides = model.robot.joint_map().prismatic
    in_degrees = np.rad2deg(readings) if slides is None else np.where(slides, readings, np.rad2deg(readings))
    if data.has("A1") and not model.inside(readings).any() and model.inside(in_degrees).all():
        last = readings.shape[1]
        what = f"A1…A{last} are radians: no row is inside the measured region as degrees, and all are as radians"
        raise InputError(Problem(data.file, 1, 0, what, f"write degrees, or name the columns q1…q{last}"))


def _assumed(model: ModelFile, at: Postures) -> tuple[str, ...]:
    return tuple(words for effect in model.robot_model().effects for words in effect.lacks(at))


def _cells(sigma: Floats | None, rows: int) -> list[float | None]:
    if sigma is None:
        return [None] * rows
    return [None if np.isnan(value) else round(float(value), 9) for value in sigma]
