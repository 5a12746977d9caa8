"""Compensation of targets, with joints for each or the reason why there are none, and of KRL programs."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cellctl.clock import calendar_time
from cellctl.compensation import METHODS, MappedErrors, PredictedErrors
from cellctl.error_maps import ErrorMap
from cellctl.facade._views import LEAST_MM, SHOWN, errors_of_each, html_table, number_cells, soft, summary_cells, view
from cellctl.facade.frames import (
    by_index,
    columns_of,
    data_set_of,
    frame_of,
    is_frame,
    numbers,
    poses,
    postures,
    refused,
)
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import DataSet, ModelFile, TableFile
from cellctl.formats.table import Row
from cellctl.formats.table_export import compensated_records
from cellctl.formats.table_making import target_rows
from cellctl.formats.targets import Targets, read_targets
from cellctl.installed import shipped_file
from cellctl.kinematics import Bools, Floats
from cellctl.operations.compensating import (
    CellRobot,
    CompensatedTargets,
    compensate_targets,
    controller_of_model,
    refuse_model,
    refuse_other_cell,
    try_targets,
)
from cellctl.operations.programs import (
    CompensatedFiles,
    ProgramFiles,
    ProgramOptions,
    compensate_files,
    is_new_folder,
    program_files,
    refuse_method,
)
from cellctl.operations.results import as_json

MOST_PASSES = 50
"""As the command line allows."""


@final
@dataclass(frozen=True, eq=False, repr=False)
class Compensation:
    """Compensated joints of N targets.

    targets (N, 4, 4): mm, in the model's frame. nominal_joints, joints (N, n): readings that reach the target on the
    nominal and on the identified robot, deg, in full precision; tables and CSV files have six decimals.
    predicted_before_mm, predicted_after_mm (N,): distance of the identified robot's TCP from the target at these.
    sigma_mm (N,): 1 σ of that prediction, 3-D, in the frame of the targets; NaN with `errors` of a predictor that
    states none. All are NaN where `reasons` (N,) is not empty: that target has no joints that may be sent.
    """

    targets: Floats
    nominal_joints: Floats
    joints: Floats
    predicted_before_mm: Floats
    predicted_after_mm: Floats
    sigma_mm: Floats
    reasons: tuple[str, ...]
    asked: AskedTargets
    _rows: tuple[Row, ...]

    @property
    def method(self) -> str:
        """The compensation method."""
        return self.asked.method

    @property
    def reached(self) -> Bools:
        """Which targets (N,) have compensated joints."""
        return np.array([not reason for reason in self.reasons], bool)

    def __len__(self) -> int:
        return len(self.targets)

    def table(self, serial: str | None = None) -> TableFile:
        """The compensation table for the controller; `table.save(path)` writes it for `cellctl table push`.

        serial: of the controller, if neither the model nor its run names it. Raises InputError with every target that
        has no joints, as `cellctl compensate` does.
        """
        controller = controller_of_model(self.asked.path, self.asked.model, serial)
        return self.asked.all_of_them().table(controller, calendar_time())

    def to_csv(self, path: str | Path) -> None:
        """Write the file that `cellctl compensate -o FILE.csv` writes (docs/reference/compensation.md).

        Raises InputError with every target that has no joints; `to_frame` has the others. Raises OSError.
        """
        write_atomically(Path(path), self.asked.all_of_them().csv())

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """The columns of that file in full precision, and `reason`; NaN where a target has no joints."""
        records = compensated_records(self.asked.model, list(self._rows))
        return columns_of(
            {**record, **(dict.fromkeys([*record][6:], math.nan) if reason else {}), "reason": reason}  # but the target
            for record, reason in zip(records, self.reasons, strict=True)
        )

    def to_frame(self) -> Any:
        """The same as a pandas DataFrame."""
        return frame_of(self.to_dict())

    def __repr__(self) -> str:
        return f"<cellctl compensation by {self.method}: {int(self.reached.sum())} of {len(self)} targets>"

    def _repr_html_(self) -> str:
        reached, count = self.reached, len(self)
        title = f"{int(reached.sum())} of {count} targets compensated by {self.method}"
        missing = [(row, reason) for row, reason in enumerate(self.reasons) if reason]
        reasons = [soft(f"target {row}: {reason}") for row, reason in missing[:SHOWN]]
        if len(missing) > SHOWN:
            reasons.append(soft(f"… and {len(missing) - SHOWN} more"))
        if not reached.any():
            return view(title, *reasons)
        pairs = {"nominal joints": self.predicted_before_mm, "compensated joints": self.predicted_after_mm}
        rows = [[name, *summary_cells(errors[reached])] for name, errors in pairs.items()]
        if np.isfinite(self.sigma_mm[reached]).all():
            rows.append(["1 σ of the prediction", *summary_cells(self.sigma_mm[reached])])
        turned = float(np.abs(self.joints - self.nominal_joints)[reached].max())
        head = ["predicted error, mm", "mean", "RMS", "max"]
        words = soft(f"Joints corrected by up to {turned:.3f}°. Errors below {LEAST_MM:g} mm are drawn at that value.")
        return view(
            title,
            html_table(head, rows),
            errors_of_each(self.predicted_before_mm, self.predicted_after_mm),
            words,
            *reasons,
        )


@final
@dataclass(frozen=True, eq=False)
class AskedTargets:
    """The targets as asked for: model and its file, targets and the name of their source, method, passes, errors of
    another predictor, largest correction of a joint (deg). memory: the targets are from no file.
    """

    model: ModelFile
    path: Path | None
    wanted: Targets
    file: str
    memory: bool
    method: str
    passes: int | None
    errors: PredictedErrors | None
    limit_deg: float

    def all_of_them(self) -> CompensatedTargets:
        """The targets, compensated. Raises InputError with every one that has no joints."""
        try:
            return compensate_targets(
                self.model,
                self.wanted,
                self.file,
                method=self.method,
                passes=self.passes,
                errors=self.errors,
                correction_deg=self.limit_deg,
            )
        except InputError as error:
            if not self.memory:
                raise
            raise by_index(error) from error


def asked_targets(
    model: ModelFile,
    path: Path | None,
    targets: Any,
    start: ArrayLike | None,
    cell: str | Path | None,
    *,
    method: str = "pseudo-target",
    passes: int | None = None,
    errors: ErrorMap | Callable[[Floats], Floats] | None = None,
) -> AskedTargets:
    """The targets, read. errors: an error map, or takes readings (N, n), deg. Raises InputError for these, for the
    method, for another robot or tool than the cell's, and for a model that needs more data than a target has.
    """
    _refuse_method(method, passes, other_predictor=errors is not None)
    place = CellRobot.load(shipped_file("cell", Path(cell))) if cell is not None else None
    if place:
        refuse_other_cell(model, str(path or "model"), place)
    memory = not isinstance(targets, str | Path)
    file = "targets" if memory else str(targets)
    refuse_model(model, file)
    limit = place.correction_deg if place else math.inf
    wanted = _wanted(model, targets, start)
    predictor = None if errors is None else _at_model_angles(errors, model)
    return AskedTargets(model, path, wanted, file, memory, method, passes, predictor, limit)


def compensated(asked: AskedTargets) -> Compensation:
    """See `Model.compensate`."""
    tried = try_targets(
        asked.model,
        asked.wanted,
        method=asked.method,
        passes=asked.passes,
        errors=asked.errors,
        correction_deg=asked.limit_deg,
    )
    reasons = tuple("; ".join(each) for each in tried.reasons)
    rows = target_rows(asked.model, asked.wanted.poses, tried.found, asked.errors, exact=True)
    bad = np.array([bool(reason) for reason in reasons])

    def column(name: str) -> Floats:
        values = np.array([getattr(row, name) for row in rows], float)
        values[bad] = np.nan
        return values

    return Compensation(
        asked.wanted.poses,
        column("nominal"),
        column("compensated"),
        column("predicted_before_mm"),
        column("predicted_after_mm"),
        column("sigma_mm"),
        reasons,
        asked,
        tuple(rows),
    )


def _refuse_method(method: str, passes: int | None, *, other_predictor: bool) -> None:
    if method not in METHODS:
        what = f"'{method}' is not known"
        raise refused("--method", what, f"one of: {', '.join(METHODS)}; compare_methods() for all of them")
    if other_predictor and not METHODS[method].position_only:
        takes = ", ".join(name for name, each in METHODS.items() if each.position_only)
        raise refused("errors", f"are not for the method '{method}'", f"take method={takes}")
    if passes is not None and not 1 <= passes <= MOST_PASSES:
        raise refused("--passes", f"{passes} is out of range", f"1 to {MOST_PASSES}, or leave it out")


def _at_model_angles(errors: ErrorMap | Callable[[Floats], Floats], model: ModelFile) -> PredictedErrors:
    if not callable(errors):
        return MappedErrors(errors)
    joints = model.robot.joint_map()

    def at(q: Floats) -> Floats:
        found = numbers(errors(joints.readings(q)), "errors")
        if found.shape != (*q.shape[:-1], 3):
            what = f"gave the shape {found.shape} for readings of the shape {q.shape}"
            raise refused("errors", what, "X, Y, Z of each posture, mm: (N, 3)")
        return found

    return at


def _wanted(model: ModelFile, targets: Any, start: ArrayLike | None) -> Targets:
    robot, name = model.robot, "targets"
    columns = is_frame(targets) or isinstance(targets, Mapping)
    if start is not None and (columns or isinstance(targets, str | Path)):
        raise refused("postures", "go with an array of poses only", "name them in columns A1…An beside X, Y, Z")
    if isinstance(targets, str | Path):
        return read_targets(DataSet.load(Path(targets)), robot)
    if columns:
        try:
            return read_targets(data_set_of(targets, name), robot)
        except InputError as error:
            raise by_index(error) from error
    frames = poses(targets, name)
    near = postures(start, robot.n, "postures") if start is not None else None
    if near is not None and len(near) != len(frames):
        raise refused("postures", f"has {len(near)} rows for {len(frames)} targets", "one posture for each target")
    return Targets(frames, near, tuple(range(2, len(frames) + 2)))


@final
@dataclass(frozen=True, eq=False, repr=False)
class CompensatedProgram:
    """A KRL or URScript program with compensated points (docs/programs.md).

    report: the JSON of `cellctl compensate program.src`: compensated `points`, places `left` as they were (file,
    line, reason), corrections, predicted errors, `paths` between the points; `files` is empty.
    """

    files: ProgramFiles
    report: Mapping[str, Any]
    _found: CompensatedFiles

    @classmethod
    def of(
        cls,
        model: ModelFile,
        name: str,
        program: Path,
        method: str,
        cell: str | Path | None,
        options: ProgramOptions,
    ) -> Self:
        """See `Model.compensate_program`."""
        refuse_method(method)
        files = program_files(program, options.config)
        place = CellRobot.load(shipped_file("cell", Path(cell))) if cell is not None else None
        found = compensate_files(model, name, files, method, options, place)
        return cls(files, as_json(found.figures()), found)

    @property
    def counts(self) -> str:
        """How many points are compensated, and how many places are not."""
        made, left = self.report["compensated"], len(self.report["left"])
        points, places = "point" if made == 1 else "points", "place" if left == 1 else "places"
        return f"{self.files.main.name}: {made} {points} compensated, {left} {places} left unchanged"

    @property
    def texts(self) -> dict[str, bytes]:
        """The changed files: `src`, and `dat` where the program has a data list; `script`."""
        return self._found.texts()

    def save(self, out: str | Path) -> list[Path]:
        """Write the changed files into a folder, or as a program with its data list; returns their paths.

        Raises InputError where that would replace the program itself. Raises OSError.
        """
        paths = self.files.outputs(Path(out))
        read = {os.path.realpath(path) for path in self.files.read}
        problems = [
            Problem(str(path), 0, 0, "is read here: it would be written over", "give another folder or file")
            for path in paths.values()
            if os.path.realpath(path) in read
        ]
        if problems:
            raise InputError(problems)
        texts = self.texts
        if is_new_folder(Path(out)):
            Path(out).mkdir()
        for part, path in paths.items():
            write_atomically(path, texts[part])
        return list(paths.values())

    def __repr__(self) -> str:
        return f"<cellctl program {self.counts}>"

    def _repr_html_(self) -> str:
        report = self.report
        keys = {
            "before_mm": "predicted error before, mm",
            "after_mm": "after, mm",
            "correction_mm": "shift of the points, mm",
            "correction_deg": "correction of the joints, deg",
        }
        rows = [
            [words, *number_cells([report[key][name] for name in ("mean", "rms", "max")])]
            for key, words in keys.items()
        ]
        left = [
            soft(f"{each['file']}:{each['line']}: {each['name']} {each['reason']}") for each in report["left"][:SHOWN]
        ]
        if len(report["left"]) > SHOWN:
            left.append(soft(f"… and {len(report['left']) - SHOWN} more"))
        before, after = (np.array([point[key] for point in report["points"]]) for key in ("before_mm", "after_mm"))
        picture = errors_of_each(before, after, "point", ("before", "after"))
        return view(self.counts, html_table(["", "mean", "RMS", "max"], rows), picture, *left)


def frame_text(frame: str | Sequence[float] | None) -> str | None:
    """X, Y, Z, A, B, C as on the command line."""
    return frame if frame is None or isinstance(frame, str) else ",".join(repr(float(value)) for value in frame)
