"""Nominal robots and data sets: the input of a fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cellctl.facade._views import SHOWN, html_table, soft, view
from cellctl.facade.frames import data_set_of, frame_of, is_frame, postures, refused
from cellctl.files import Document
from cellctl.formats import DataSet, RobotFile
from cellctl.installed import shipped_file
from cellctl.kinematics import Floats
from cellctl.operations.fitting import robot_of

_UNITS = {"A": "deg", "q": "rad", "D": "direction", "I": "A"}
_MM, _DEG = {"X", "Y", "Z", "sX", "sY", "sZ", "radius", "distance"}, {"A", "B", "C"}


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
        file = self.file
        rows = [
            [f"A{number}", f"{joint.min:g}", f"{joint.max:g}", f"{joint.max_speed:g}"]
            for number, joint in enumerate(file.joints, 1)
        ]
        xyz = ", ".join(f"{value:g}" for value in file.tool.xyz)
        facts = f"{file.convention}, repeatability {file.repeatability:g} mm (1 σ, 3-D), tool at {xyz} mm"
        return view(self.name, soft(facts), html_table(["joint", "least, deg", "greatest, deg", "deg/s"], rows))


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
        rows = [_range(name, self[name]) for name in self.columns]
        rejected = [soft(f"line {row.line}: {row.reason}") for row in self.rows.rejected[:SHOWN]]
        head = ["column", "unit", "values", "least", "greatest"]
        return view(f"{self.rows.file}: {len(self)} rows", html_table(head, rows), *rejected)


def _range(name: str, values: Any) -> list[str]:
    if values.dtype.kind != "f":
        labels = sorted({text for text in values.tolist() if text})
        some = ", ".join(labels[:3]) + (", …" if len(labels) > 3 else "")
        return [name, "", str(sum(map(bool, values.tolist()))), some, ""]
    filled = values[np.isfinite(values)]
    ends = [f"{filled.min():.6g}", f"{filled.max():.6g}"] if filled.size else ["", ""]
    return [name, _unit(name), str(filled.size), *ends]


def _unit(name: str) -> str:
    if name in _MM or name in _DEG:
        return "mm" if name in _MM else "deg"
    return _UNITS.get(name[:1], "") if name[1:].isdigit() else {"temperature": "°C", "payload": "kg"}.get(name, "")


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
