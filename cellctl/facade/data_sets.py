"""Data sets: of a file, a DataFrame or arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from cellctl.facade.arrays import refused
from cellctl.facade.frames import data_set_of, frame_of, is_frame
from cellctl.formats import DataSet

if TYPE_CHECKING:
    from numpy.typing import NDArray


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
        import numpy as np

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
        from cellctl.facade.views import data_view

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
