"""Compensation of targets: joints for each, or the reason why there are none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from cellctl.facade.arrays import poses, postures, refused
from cellctl.facade.frames import by_index, columns_of, data_set_of, frame_of, is_frame
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import DataSet, ModelFile, TableFile
from cellctl.formats.dataset import text_of
from cellctl.formats.targets import Targets, read_targets

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cellctl.compensation import Compensated
    from cellctl.formats.table import Row
    from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, eq=False, repr=False)
class Compensation:
    """Compensated joints of N targets.

    targets (N, 4, 4): mm, in the model's frame. nominal_joints, joints (N, n): readings that reach the target on the
    nominal and on the identified robot, deg, rounded as the controller takes them. predicted_before_mm,
    predicted_after_mm (N,): distance of the identified robot's TCP from the target at these. sigma_mm (N,): 1 σ of that
    prediction, 3-D. All are NaN where `reasons` (N,) is not empty: that target has no joints that may be sent.
    """

    targets: Floats
    nominal_joints: Floats
    joints: Floats
    predicted_before_mm: Floats
    predicted_after_mm: Floats
    sigma_mm: Floats
    reasons: tuple[str, ...]
    method: str
    _source: _Source

    @property
    def reached(self) -> Bools:
        """Which targets (N,) have compensated joints."""
        import numpy as np

        return np.array([not reason for reason in self.reasons], bool)

    def __len__(self) -> int:
        return len(self.targets)

    def table(self, serial: str | None = None) -> TableFile:
        """The compensation table for the controller; `table.save(path)` writes it for `cellctl table push`.

        serial: of the controller, if neither the model nor its run names it. Raises InputError with every target that
        has no joints, as `cellctl compensate` does.
        """
        from cellctl.clock import calendar_time
        from cellctl.operations.compensating import CompensatedTargets
        from cellctl.operations.learnt_on import learnt_on

        source = self._source
        if source.problems or source.found is None:
            raise InputError(source.problems)
        learnt = learnt_on(source.path, source.model, serial)
        return CompensatedTargets(source.model, source.wanted, self.method, source.found).table(learnt, calendar_time())

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """Columns: X, Y, Z (mm), A, B, C (deg) of the target; A1…An, nominal_A1… (deg); before, after, sigma
        (mm); reason.
        """
        return columns_of(self._records())

    def to_frame(self) -> Any:
        """The same as a pandas DataFrame."""
        return frame_of(self.to_dict())

    def to_csv(self, path: str | Path) -> None:
        """Write the same as CSV; empty cells where a target has no joints. Raises OSError."""
        rows = [{key: None if value != value else value for key, value in row.items()} for row in self._records()]
        write_atomically(Path(path), text_of(rows))

    def _records(self) -> list[dict[str, Any]]:
        import numpy as np

        from cellctl.kinematics import abc_from_rotation

        names = [f"A{number}" for number in range(1, self.joints.shape[1] + 1)]
        heads = [
            "X",
            "Y",
            "Z",
            "A",
            "B",
            "C",
            *names,
            *(f"nominal_{name}" for name in names),
            "before",
            "after",
            "sigma",
        ]
        turns = np.round(abc_from_rotation(self.targets[:, :3, :3]), 9)
        figures = (self.predicted_before_mm, self.predicted_after_mm, self.sigma_mm)
        rows = np.column_stack([self.targets[:, :3, 3], turns, self.joints, self.nominal_joints, *figures]).tolist()
        return [
            {**dict(zip(heads, row, strict=True)), "reason": why} for row, why in zip(rows, self.reasons, strict=True)
        ]

    def __repr__(self) -> str:
        return f"<cellctl compensation by {self.method}: {int(self.reached.sum())} of {len(self)} targets>"

    def _repr_html_(self) -> str:
        from cellctl.facade.views import compensation_view

        return compensation_view(self)


@final
@dataclass(frozen=True, eq=False)
class _Source:
    """What a table is made from. problems: of the targets without joints; found: None if no target has any."""

    model: ModelFile
    path: Path | None
    wanted: Targets
    found: Compensated | None
    problems: tuple[Problem, ...]


def compensated(
    model: ModelFile, path: Path | None, targets: Any, start: ArrayLike | None, method: str
) -> Compensation:
    """See `Model.compensate`; path: the model's file."""
    from cellctl.compensation import METHODS
    from cellctl.formats.table_making import target_rows

    if method not in METHODS:
        raise refused("--method", f"'{method}' is not known", f"one of: {', '.join(METHODS)}")
    wanted, file = _wanted(model, targets, start)
    kept, found, problems = _joints(model, wanted, file, method)
    rows, reasons = target_rows(model, wanted.poses[kept], found) if found else [], _reasons(wanted, problems)
    error = InputError(problems) if isinstance(targets, str | Path) else by_index(InputError(problems))
    return _result(wanted, kept, rows, reasons, method, _Source(model, path, wanted, found, tuple(error.problems)))


def _wanted(model: ModelFile, targets: Any, start: ArrayLike | None) -> tuple[Targets, str]:
    """The targets, and the name of their source in errors."""
    robot, name = model.robot, "targets"
    columns = is_frame(targets) or isinstance(targets, Mapping)
    if start is not None and (columns or isinstance(targets, str | Path)):
        raise refused("postures", "go with an array of poses only", "name them in columns A1…An beside X, Y, Z")
    if isinstance(targets, str | Path):
        return read_targets(DataSet.load(Path(targets)), robot), str(targets)
    if columns:
        try:
            return read_targets(data_set_of(targets, name), robot), name
        except InputError as error:
            raise by_index(error) from error
    frames = poses(targets, name)
    near = postures(start, robot.n, "postures") if start is not None else None
    if near is not None and len(near) != len(frames):
        raise refused("postures", f"has {len(near)} rows for {len(frames)} targets", "one posture for each target")
    return Targets(frames, near, tuple(range(2, len(frames) + 2))), name


def _joints(
    model: ModelFile, wanted: Targets, file: str, method: str
) -> tuple[list[int], Compensated | None, list[Problem]]:
    """Indices of the targets that have joints, these, and the problems of the others. Raises InputError if the model
    cannot be used at all.
    """
    from cellctl.operations.compensating import compensate_targets

    kept, problems = list(range(len(wanted.lines))), list[Problem]()
    while kept:
        lines = tuple(wanted.lines[row] for row in kept)
        near = wanted.postures[kept] if wanted.postures is not None else None
        try:
            some = compensate_targets(model, Targets(wanted.poses[kept], near, lines), file, method=method)
        except InputError as error:
            mine = [each for each in error.problems if each.line in lines]
            if not mine:
                raise
            problems += mine
            kept = [row for row in kept if wanted.lines[row] not in {each.line for each in mine}]
        else:
            return kept, some.found, problems
    return [], None, problems


def _reasons(wanted: Targets, problems: Sequence[Problem]) -> tuple[str, ...]:
    found: dict[int, list[str]] = {}
    for each in problems:
        found.setdefault(each.line, []).append(each.what)
    return tuple("; ".join(found.get(line, [])) for line in wanted.lines)


def _result(
    wanted: Targets, kept: list[int], rows: Sequence[Row], reasons: tuple[str, ...], method: str, source: _Source
) -> Compensation:
    import numpy as np

    def spread(values: list[Any], width: tuple[int, ...] = ()) -> Floats:
        array = np.full((len(wanted.lines), *width), np.nan)
        if kept:
            array[kept] = values
        return array

    n = (source.model.robot.n,)
    return Compensation(
        wanted.poses,
        spread([row.nominal for row in rows], n),
        spread([row.compensated for row in rows], n),
        spread([row.predicted_before_mm for row in rows]),
        spread([row.predicted_after_mm for row in rows]),
        spread([row.sigma_mm for row in rows]),
        reasons,
        method,
        source,
    )
