"""Nominal robots, data sets, and `cellctl.fit`: the fit of the command line, for Python."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cellctl.calibration.estimation.progress import Progress
from cellctl.facade._models import Model, load
from cellctl.facade._views import data_view, robot_view
from cellctl.facade.frames import data_set_of, frame_of, is_frame, postures, refused
from cellctl.files import Document
from cellctl.formats import DataSet, RobotFile, load_artefact
from cellctl.installed import shipped_file
from cellctl.kinematics import Floats
from cellctl.operations.fit_options import Asked, Judging
from cellctl.operations.fitting import FitInput, fit_rows, robot_of


@final
@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A nominal robot. file: the content of its robot file; document: that file with its positions."""

    file: RobotFile
    document: Document

    @property
    def name(self) -> str:
        """Name in the robot file."""
        return self.file.name

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.file.n

    @property
    def limits(self) -> Floats:
        """Joint limits (n, 2), controller readings, deg: lower, upper."""
        return self.file.limits()

    def forward(self, q: ArrayLike) -> Floats:
        """Poses (N, 4, 4), mm, of the TCP at controller readings `q` (N, n), deg; (4, 4) for one posture (n,).

        Base and tool are those of the robot file. Raises InputError for another shape, and for values that are not
        finite.
        """
        readings = postures(q, self.n)
        found = self.file.chain().forward(self.file.joint_map().model(readings))
        return np.asarray(found[0] if np.ndim(q) == 1 else found)

    def __repr__(self) -> str:
        return f"<cellctl robot {self.name}: {self.n} joints>"

    def _repr_html_(self) -> str:

        return robot_view(self)


def robot(source: str | Path | RobotFile | Robot) -> Robot:
    """A nominal robot: name of a library robot (`"ur10"`), path of a robot file, or a `RobotFile`.

    Raises InputError: no such robot or file, or every error in it with line and column.
    """
    if isinstance(source, Robot):
        return source
    if isinstance(source, RobotFile):
        return Robot(source, Document(source.name, "", source.model_dump(), {(): (0, 0)}, {}))
    if isinstance(source, str | Path):
        document, file = robot_of(shipped_file("robot", Path(source)))
        return Robot(file, document)
    cure = "a library name such as 'ur10', the path of a robot file, or a RobotFile"
    raise refused("robot", f"is a {type(source).__name__}", cure)


@final
@dataclass(frozen=True, eq=False, repr=False)
class Data:
    """A data set: joint readings and measurements, one row for each measurement (docs/reference/data-sets.md).

    rows: its cells. Row i of arrays is line i + 2 in messages and reports, as in the file that `to_csv` writes.
    """

    rows: DataSet

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns; a name defines content and unit (`A1`: deg, `q1`: rad, `X`: mm)."""
        return self.rows.columns

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, column: str) -> NDArray[Any]:
        """A column (N,): numbers, NaN where missing; text where not all of its cells are numbers."""
        if not self.rows.has(column):
            raise KeyError(f"{column}: the columns are {', '.join(self.columns)}")
        cells = self.rows.values(column)
        try:
            return np.array([np.nan if cell == "" else float(cell) for cell in cells])
        except ValueError:
            return np.array([str(cell) for cell in cells])

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """All columns, by name."""
        return {name: self[name] for name in self.columns}

    def to_frame(self) -> Any:
        """A pandas DataFrame."""
        return frame_of(self.to_dict())

    def to_csv(self, path: str | Path) -> None:
        """Write the data set as a file for `cellctl fit`. Raises OSError."""
        self.rows.write(Path(path))

    def __repr__(self) -> str:
        return f"<cellctl data {self.rows.file}: {len(self)} rows, {', '.join(self.columns)}>"

    def _repr_html_(self) -> str:

        return data_view(self)


def read(source: Any) -> Data:
    """A data set from the path of a CSV file, a pandas DataFrame, or a mapping of arrays (N,).

    The names of the columns are those of data-set files: `A1…An` (deg) or `q1…qn` (rad); `X, Y, Z` (mm); `A, B, C`
    (deg) or `QW, QX, QY, QZ`; … Raises InputError where it cannot be used as a whole; a fit lists single bad rows.
    """
    if isinstance(source, Data):
        return source
    if isinstance(source, str | Path):
        return Data(DataSet.load(Path(source)))
    if is_frame(source) or isinstance(source, Mapping):
        return Data(data_set_of(source, "data"))
    cure = "the path of a CSV file, a DataFrame, or a mapping from column to array"
    raise refused("data", f"is a {type(source).__name__}", cure)


_DEFAULT_PRIOR = Path("prior")


def fit(
    robot: str | Path | RobotFile | Robot,
    data: Any,
    *,
    measure: str | None = None,
    model: str = "auto",
    artefact: str | Path | None = None,
    distances: bool = True,
    spacing: str | Sequence[str] = (),
    own: str | Sequence[str] = "base",
    prior: str | Path | Model | None = None,
    free: str | Sequence[str] | None = None,
    check: bool = True,
    holdout: float | None = None,
    folds: int | None = None,
    column: str | None = None,
    by: str | None = None,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Model:
    """Identify a robot, and judge it on held-out rows, as `cellctl fit` does (docs/reference/fit.md).

    - robot: as `cellctl.robot` takes it. data: as `cellctl.read` takes it.
    - measure: use rows of one kind (position, pose, sphere, plane, socket, distance).
    - model: `auto`, `registration`, `geometry` or `zeros`, and effects (`geometry+compliance`).
    - artefact: file with spheres, sockets and certified distances; distances: use these.
    - spacing: known distances, `"A,B=50±0.01"`, mm and 1 σ.
    - own: what each session has for itself (`base`, `tool`, both, `none`).
    - prior: model to be updated; free: groups that may change.
    - check: look for set-up errors first.
    - holdout (share of the rows), folds (number), column (`set`), by (a column, such as `session`): how rows are held
      out; by default the column `set`, else five folds. seed: of the random hold-out.
    - progress: is called with the activity and the share (0 … 1) of its work.

    Raises InputError with all errors of the call, of the files, or of the set-up. Messages name options as on the
    command line. The same seed gives the same model.
    """
    asked = Asked(
        measure,
        model,
        Path(artefact) if artefact is not None else None,
        distances,
        (spacing,) if isinstance(spacing, str) else tuple(spacing),
        _joined(own),
        _name_of(prior),
        _joined(free) if free is not None else None,
    )
    judging = Judging(holdout, folds, column, by, seed)
    asked.refuse(judging)

    given = _given(robot, data, asked, prior)
    shown = None if progress is None else _told(progress)
    return Model.fitted(fit_rows(given, asked, judging, shown, check=check))


def _given(
    source: str | Path | RobotFile | Robot, data: Any, asked: Asked, prior: str | Path | Model | None
) -> FitInput:
    """The input, read; two paths are read as by the command line, which recognises swapped files."""
    if isinstance(source, str | Path) and isinstance(data, str | Path) and not isinstance(prior, Model):
        return FitInput.load(shipped_file("robot", Path(source)), Path(data), asked)

    def given_robot() -> tuple[Any, RobotFile]:
        found = robot(source)
        return found.document, found.file

    return FitInput.read(
        given_robot,
        lambda: read(data).rows,
        lambda: load_artefact(asked.artefact) if asked.artefact else None,
        lambda: None if prior is None else prior.file if isinstance(prior, Model) else load(prior).file,
    )


def _joined(names: str | Sequence[str]) -> str:
    return names if isinstance(names, str) else ",".join(names)


def _name_of(prior: str | Path | Model | None) -> Path | None:
    if isinstance(prior, Model):
        return prior.path or _DEFAULT_PRIOR
    return Path(prior) if prior is not None else None


def _told(progress: Progress) -> Callable[[str], Any]:
    """Reports of the check and of the fit, each from 0 to 1, to `progress`."""

    @contextmanager
    def shown(name: str) -> Iterator[Progress]:
        yield lambda doing, share: progress(": ".join(word for word in (name, doing) if word), share)

    return shown
