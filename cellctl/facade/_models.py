"""Identified robots: predictions of their TCP, and their forms for other programs and controllers."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cellctl.error_maps import ErrorMap
from cellctl.facade._inputs import Robot, robot
from cellctl.facade._targets import CompensatedProgram, Compensation, asked_targets, compensated, frame_text
from cellctl.facade._views import (
    SHOWN,
    bars_before_and_after,
    errors_before_and_after,
    html_table,
    number_cells,
    soft,
    verdict_line,
    view,
)
from cellctl.facade.frames import by_index, columns_of, data_set_of, frame_of, is_frame, postures, refused
from cellctl.files import InputError, write_atomically
from cellctl.formats import DataSet, ModelFile
from cellctl.formats.table_making import nominal_chain
from cellctl.kinematics import Bools, Floats
from cellctl.operations.compensating import compare_methods
from cellctl.operations.exporting import ExportOptions, exported, model_source
from cellctl.operations.fitting import Fitted
from cellctl.operations.predicting import Predicted, predict_rows
from cellctl.operations.programs import ProgramOptions
from cellctl.operations.results import as_json
from cellctl.report.figures import fit_lines

Form: TypeAlias = Literal["mdh-hayati", "dh-craig", "poe", "urdf", "dh-csv", "ur-calibration", "kuka", "abb", "fanuc"]
_TABLES = ("mdh-hayati", "dh-craig")
_CONVENTIONS = (*_TABLES, "poe")
_COUNTS = {"n_fit": "rows to fit", "n_test": "held out", "n_parameters": "parameters", "rank": "observable"}


def export(model: ModelFile, name: str, form: Form, path: str | Path | None, options: ExportOptions) -> str | bytes:
    """The content of the file, written to `path` if given. Warns of what the form cannot hold, with the distance that
    this costs. name: of the model in errors. Raises InputError where the model has no such form; OSError.
    """
    made = exported(model_source(model, name), form, options)
    for line in made.lines():
        warnings.warn(line, stacklevel=4)
    if path is not None:
        write_atomically(Path(path), made.content)
    return made.content


def refuse_convention(convention: str, *, table: bool) -> None:
    """Raise InputError if `convention` is none of a robot file (table: of a DH table)."""
    known = _TABLES if table else _CONVENTIONS
    if convention not in known:
        raise refused("convention", f"'{convention}' is not known", f"one of: {', '.join(known)}")


@final
@dataclass(frozen=True, eq=False, repr=False)
class Prediction:
    """Predicted TCPs of N postures, in the model's frame (the instrument's, or that of the touched spheres).

    joints (N, n): controller readings, deg. poses (N, 4, 4), positions (N, 3): mm. sigma_mm (N,): 1 σ, 3-D, in the
    `frame` that was asked for; the same in both where an instrument measured.
    sigma_among_mm (N,): 1 σ relative to each other, without common rigid motions; NaN for fewer than four postures.
    radius_95_mm (N,): 95 % of places are within it: 1.61 σ, and more where touches show that the model lacks something.
    inside (N,): within the measured region; outside it the model extrapolates, with a larger σ.
    """

    joints: Floats
    poses: Floats
    sigma_mm: Floats
    sigma_among_mm: Floats
    inside: Bools
    _rows: Predicted

    @property
    def positions(self) -> Floats:
        """TCP positions (N, 3), mm."""
        return self.poses[:, :3, 3]

    @property
    def radius_95_mm(self) -> Floats:
        """95 % radius (N,) of the places, mm."""
        return np.asarray(self._rows.radius_95 * self.sigma_mm)

    def __len__(self) -> int:
        return len(self.poses)

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """The columns of `cellctl predict`: A1…An (deg), X, Y, Z (mm), A, B, C (deg), sigma, sigma_among (mm), seen."""
        return columns_of(self._rows.records())

    def to_frame(self) -> Any:
        """The same as a pandas DataFrame."""
        return frame_of(self.to_dict())

    def to_csv(self, path: str | Path) -> None:
        """Write the file that `cellctl predict -o` writes. Raises OSError."""
        write_atomically(Path(path), self._rows.text())

    def __repr__(self) -> str:
        return f"<cellctl prediction: {len(self)} postures, {int((~self.inside).sum())} outside the measured region>"

    def _repr_html_(self) -> str:
        values = np.column_stack([self.positions, self.sigma_mm])[:SHOWN]
        marks = ["" if inside else "outside the measured region" for inside in self.inside]
        rows = [
            [str(row), *number_cells(line), mark] for row, (line, mark) in enumerate(zip(values, marks, strict=False))
        ]
        left = len(self) - len(rows)
        outside = int((~self.inside).sum())
        title = f"{len(self)} postures predicted, {outside} outside the measured region"
        more = [soft(f"… and {left} more")] if left else []
        return view(title, html_table(["row", "X, mm", "Y, mm", "Z, mm", "1 σ, mm", ""], rows), *more)


def predicted(model: ModelFile, q: Any, frame: str) -> Prediction:
    """See `Model.predict`."""
    try:
        found = predict_rows(model, _joints(model, q), frame=frame)
    except InputError as error:
        if isinstance(q, str | Path):
            raise
        raise by_index(error) from error
    for words in found.assumed:
        warnings.warn(words, stacklevel=3)
    among = found.sigma_among_mm if found.sigma_among_mm is not None else np.full(len(found.poses), np.nan)
    return Prediction(found.readings, found.poses, found.sigma_mm, among, found.inside, found)


def _joints(model: ModelFile, q: Any) -> DataSet:
    if isinstance(q, str | Path):
        return DataSet.load(Path(q))
    if is_frame(q) or isinstance(q, Mapping):
        return data_set_of(q, "q")
    names = [f"A{number}" for number in range(1, model.robot.n + 1)]
    rows = postures(q, model.robot.n).tolist()
    return DataSet.of_records([dict(zip(names, row, strict=True)) for row in rows], "q")


@final
@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """An identified robot.

    file: the content of its model file. report: the JSON of `cellctl fit` without `seconds`; of a loaded model the
    figures that its file holds. path: the file that it was loaded from.
    """

    file: ModelFile
    report: Mapping[str, Any]
    path: Path | None = None
    _fit: Fitted | None = None

    @classmethod
    def fitted(cls, fit: Fitted) -> Self:
        """The model of a fit."""
        return cls(fit.model(), json.loads(json.dumps(fit.report)), None, fit)

    @property
    def robot(self) -> Robot:
        """The nominal robot."""
        return robot(self.file.robot)

    @property
    def verdict(self) -> str:
        """`better`, `no better` or `worse` than nominal, on held-out rows."""
        return str(self.report.get("verdict", ""))

    @property
    def sentence(self) -> str:
        """The verdict with its figures; of a loaded model the verdict alone."""
        return str(self.report.get("sentence") or f"Verdict on held-out rows: {self.verdict or 'none'}.")

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """Deviations from nominal: name, unit, value, σ after (`sigma`) and before (`prior_sigma`) the measurement."""
        return [parameter.model_dump() for parameter in self.file.parameters]

    def predict(self, q: Any, *, frame: Literal["base", "points"] = "base") -> Prediction:
        """Predict the TCP at joint readings.

        q: array (N, n) or (n,), deg; or DataFrame, mapping of arrays or path of a CSV with `A1…An` (deg) or `q1…qn`
        (rad), and the conditions of each row (`temperature`, `payload`, `D1…Dn`) as in data sets. Raises InputError
        with every row that cannot be used. Warns of conditions that the model needs and `q` does not state. frame: σ
        is of the TCP in the robot's `base`, or, for a model from touches, relative to the touched `points`, as in
        `compensate`. Touches do not determine the base's heading and height.
        """
        return predicted(self.file, q, frame)

    def nominal_poses(self, q: ArrayLike) -> Floats:
        """Poses (N, 4, 4), mm, in the model's frame, that the nominal robot would reach at controller readings `q`
        (N, n), deg: the targets of a program of joint positions. Base and tool are those from which the model counts.
        """
        return nominal_chain(self.file).forward(self.file.robot.joint_map().model(postures(q, self.file.robot.n)))

    def compensate(
        self,
        targets: Any,
        *,
        postures: ArrayLike | None = None,
        method: str = "pseudo-target",
        passes: int | None = None,
        cell: str | Path | None = None,
        errors: ErrorMap | Callable[[Floats], Floats] | None = None,
    ) -> Compensation:
        """Compute the joints that move the identified robot to targets, as `cellctl compensate` does.

        targets: poses of the TCP in the model's frame: array (N, 4, 4), mm; or DataFrame, mapping of arrays or path of
        a CSV with X, Y, Z (mm), A, B, C (deg) or QW, QX, QY, QZ, and `A1…An` (deg) of a posture nearby. postures: the
        same postures (N, n), deg, for an array. method, passes: docs/reference/compensation.md. cell: file or name of
        a cell; its robot and tool have to be the model's, and its limit of a correction holds. errors: another
        predictor for the method `cyclic-search`: a function from readings (N, n), deg, to the errors (N, 3), mm, of the
        nominal robot's TCP in the model's frame; or an error map over model angles (N, n), rad, whose own σ is stated
        if it has one (docs/reference/error-maps.md).

        A target without usable joints has its reason in the result. Raises InputError for targets that cannot be read,
        and for a model that needs more data than a target has.
        """
        return compensated(
            asked_targets(self.file, self.path, targets, postures, cell, method=method, passes=passes, errors=errors)
        )

    def compare_methods(
        self, targets: Any, *, postures: ArrayLike | None = None, cell: str | Path | None = None
    ) -> list[dict[str, Any]]:
        """The figures of every compensation method on the same targets, as `cellctl compensate --method all --json`.

        Arguments and errors as in `compensate`.
        """
        asked = asked_targets(self.file, self.path, targets, postures, cell)
        return [as_json(each) for each in compare_methods(asked.model, asked.wanted, asked.file, asked.limit_deg)]

    def compensate_program(
        self,
        program: str | Path,
        *,
        method: str = "pseudo-target",
        cell: str | Path | None = None,
        config: str | Path | None = None,
        tool: Sequence[float] | None = None,
        base: Sequence[float] | None = None,
        path_tolerance_mm: float | None = None,
        insert: bool = False,
        arm_only: bool = False,
    ) -> CompensatedProgram:
        """Compensate the points of a program, as `cellctl compensate program.src` does (docs/programs.md).

        program: a KRL `.src`, whose `.dat` is read too, or a URScript `.script`. config: `$config.dat`. tool, base: X,
        Y, Z (mm), A, B, C (deg), where the program does not state them. path_tolerance_mm: deviation between the
        points; insert: add points where it is larger. arm_only: take the tool from the program's data. Only for points
        made off-line: taught points contain the robot's error already.

        Raises InputError if no point can be changed, with all reasons.
        """
        configured = Path(config) if config is not None else None
        options = ProgramOptions(
            configured, frame_text(tool), frame_text(base), path_tolerance_mm, insert=insert, arm_only=arm_only
        )
        name = str(self.path or "model")
        return CompensatedProgram.of(self.file, name, Path(program), method, cell, options)

    def save(self, path: str | Path) -> Model:
        """Write the model file of `cellctl fit --out`; returns the model with that path. Raises OSError."""
        self.file.save(Path(path))
        return replace(self, path=Path(path))

    def to_urdf(
        self, path: str | Path | None = None, *, into: str | Path | None = None, tip: str | None = None
    ) -> str | bytes:
        """The calibrated URDF, written to `path` if given. into: your own URDF; only its joint origins are replaced.
        tip: last link of the chain in it. This and the other `to_…` warn of what the form cannot hold, with the
        distance that this costs; they raise InputError where the model has no such form.
        """
        return self._export("urdf", path, into=Path(into) if into is not None else None, tip=tip)

    def to_ur_calibration(self, path: str | Path | None = None, *, into: str | Path | None = None) -> str | bytes:
        """The `calibration.yaml` of Universal Robots' ROS 2 description. into: your file, whose hash is kept."""
        return self._export("ur-calibration", path, into=Path(into) if into is not None else None)

    def to_dh(
        self, path: str | Path | None = None, *, convention: Literal["mdh-hayati", "dh-craig"] = "mdh-hayati"
    ) -> str | bytes:
        """A DH table as CSV, mm and degrees."""
        refuse_convention(convention, table=True)
        return self._export("dh-csv", path, table=convention)

    def to_robot_file(
        self, path: str | Path | None = None, *, convention: Literal["mdh-hayati", "dh-craig", "poe"] = "mdh-hayati"
    ) -> str | bytes:
        """A robot file with the identified geometry."""
        refuse_convention(convention, table=False)
        return self._export(convention, path)

    def to_kuka(self, path: str | Path | None = None, *, tool_number: int = 1, base_number: int = 1) -> str | bytes:
        """Mastering offsets, `TOOL_DATA` and `BASE_DATA` of a KUKA controller."""
        return self._export("kuka", path, tool=tool_number, base=base_number)

    def to_abb(self, path: str | Path | None = None) -> str | bytes:
        """Joint-zero offsets of an ABB controller."""
        return self._export("abb", path)

    def to_fanuc(self, path: str | Path | None = None) -> str | bytes:
        """Joint-zero offsets of a FANUC controller."""
        return self._export("fanuc", path)

    def _export(self, form: Form, path: str | Path | None, **options: Any) -> str | bytes:
        return export(self.file, str(self.path or "model"), form, path, ExportOptions(**options))

    def page(self, path: str | Path | None = None) -> str:
        """The report of the fit as an HTML page, written to `path` if given. Raises InputError for a loaded model: its
        file has no measured rows. Raises OSError.
        """
        if self._fit is None:
            raise refused(str(self.path or "model"), "has no measured rows to report", "call page() after cellctl.fit")
        given = self._fit.given
        text = self._fit.page(given.document.file, given.data.file)
        if path is not None:
            write_atomically(Path(path), text)
        return text

    def __repr__(self) -> str:
        return f"<cellctl model of {self.file.robot.name}: {self.file.model}, {self.verdict or 'not judged'}>"

    def _repr_html_(self) -> str:
        report = self.report
        parts = [verdict_line(self.sentence, self.verdict), _errors(fit_lines(report))]
        if self._fit is not None and self._fit.result.n_test:
            result = self._fit.result
            before = (
                result.nominal_errors if result.nominal_with_tool_errors is None else result.nominal_with_tool_errors
            )
            parts.append(errors_before_and_after(before, result.test_errors, "held-out error"))
        elif report.get("n_test"):
            parts.append(bars_before_and_after(report.get("nominal_with_tool") or report["nominal"], report["test"]))
        facts = [f"{report[key]} {words}" for key, words in _COUNTS.items() if report.get(key) is not None]
        return view(f"{self.file.robot.name}: {self.file.model}", *parts, soft(", ".join(facts)))


def _errors(lines: Iterable[Mapping[str, Any]]) -> str:
    """Errors of nominal and identified robot, as on the page of the fit."""
    rows = []
    for line in lines:
        for key, name in (("before", "nominal"), ("after", "identified")):
            if any(line[key]):
                rows.append([f"{line['what']}, {name}", *line[key]])
    return html_table(["error, mm", "mean", "RMS", "max"], rows)


def load(path: str | Path) -> Model:
    """The model in a file that `Model.save`, `cellctl fit --out` or a run wrote. Raises InputError where it is none."""
    file = ModelFile.load(Path(path))
    return Model(file, file.figures, Path(path))
