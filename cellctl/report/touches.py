"""Every touch of a run by the nominal and by the identified robot: computed anew from data set, model and artefact."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from cellctl.calibration import ErrorFigures, State, TouchRows, identify
from cellctl.files import InputError, Problem
from cellctl.formats import Artefact, DataSet, ModelFile, measurements
from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, eq=False)
class TouchErrors:
    """N touches, in the order of the data set.

    lines, numbers: line in the data set, touch number; readings (N, n), deg; spheres (N,); held_out (N,); normals
    (N, 3): from centre to tip, base frame, by the identified robot; before, after (N,): signed distance to the sphere's
    surface, mm, positive outside, by the nominal robot with fitted centres and by the identified one.
    """

    lines: tuple[int, ...]
    numbers: tuple[str, ...]
    readings: Floats
    spheres: tuple[str, ...]
    held_out: Bools
    normals: Floats
    before: Floats
    after: Floats

    def pick(self, rows: list[int]) -> TouchErrors:
        """The touches at these places."""
        return TouchErrors(
            tuple(self.lines[row] for row in rows),
            tuple(self.numbers[row] for row in rows),
            self.readings[rows],
            tuple(self.spheres[row] for row in rows),
            self.held_out[rows],
            self.normals[rows],
            self.before[rows],
            self.after[rows],
        )

    def figures(self) -> tuple[ErrorFigures, ErrorFigures]:
        """Mean, RMS and greatest distance before and after, mm, on the held-out touches."""
        before, after = (ErrorFigures.of(np.abs(errors[self.held_out])) for errors in (self.before, self.after))
        return before, after


def touch_errors(model: ModelFile, data: DataSet, artefact: Artefact | None) -> TouchErrors:
    """The errors of all usable touches of `data`. Raises InputError where the data set does not belong to the model."""
    choice = "auto" if model.robot_model().effects else "geometry"
    measured = measurements(model.robot, data, measure="sphere", model=choice, artefact=artefact)
    rows = measured.task.rows.only
    assert isinstance(rows, TouchRows)
    centres = {centre.id: centre.xyz for centre in model.centres}
    unknown = set(measured.task.points) - centres.keys()
    if unknown:
        what = f"has touches on {', '.join(sorted(unknown))}, which the model does not know"
        raise InputError(Problem(data.file, 0, 0, what, "is it the data set of this model?"))
    identified = State.alone(model.robot_model(), np.array([centres[name] for name in measured.task.points]))
    held_out = np.array([of == "test" for of in measured.sets])
    outliers = {row["line"] for row in model.figures.get("outliers", [])}
    used = np.flatnonzero(~held_out & np.array([line not in outliers for line in measured.lines]))
    only_centres = identify(replace(measured.task, groups=frozenset()), used, (np.ones(len(used), bool), 0))
    away = identified.model.tcp(rows.q) - identified.points[rows.point]
    number_at = dict(zip(data.lines, data.texts("touch"), strict=True))
    return TouchErrors(
        lines=measured.lines,
        numbers=tuple(number_at[line] for line in measured.lines),
        readings=measured.readings,
        spheres=tuple(measured.task.points[index] for index in rows.point),
        held_out=held_out,
        normals=away / np.linalg.norm(away, axis=1, keepdims=True),
        before=rows.residual(only_centres.nominal.state)[:, 0],
        after=rows.residual(identified)[:, 0],
    )
