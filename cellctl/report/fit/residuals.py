"""Residuals of every row for the nominal and the identified robot, for the pictures."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self, final

import numpy as np

from cellctl.kinematics import Bools, Floats
from cellctl.records import ResidualsRow

_DIGITS = 9
"""Significant digits of stored numbers."""


@final
@dataclass(frozen=True, eq=False)
class Residuals:
    """N rows as arrays; the columns are those of `cellctl.records.ResidualsRow`, with NaN in place of None."""

    line: Any
    number: Any
    row: Any
    session: Any
    point: Any
    on_sphere: Bools
    held_out: Bools
    outlier: Bools
    readings: Floats
    tip: Floats
    tip_base: Floats
    before: Floats
    after: Floats
    signed_before: Floats
    signed_after: Floats
    normal: Floats
    turn: Floats
    joint_before: Floats
    joint_after: Floats
    scaled: Floats
    p_value: Floats

    @classmethod
    def of_row(cls, row: ResidualsRow) -> Self:
        """From the row that a run stored."""
        kinds = {"str": str, "int": int, "bool": bool}
        columns = {each.name: str(each.type).removeprefix("tuple[").partition(",")[0] for each in fields(row)}
        return cls(**{name: np.array(getattr(row, name), kinds.get(of, float)) for name, of in columns.items()})

    def stored(self) -> ResidualsRow:
        """The row that a run stores."""
        return ResidualsRow(**{name: listed(value) for name, value in vars(self).items()})

    def pick(self, which: Any) -> Self:
        """The rows at a mask or indices."""
        return replace(self, **{name: value[which] for name, value in vars(self).items()})

    def __len__(self) -> int:
        return len(self.row)

    @property
    def distances(self) -> Bools:
        """Which rows (N,) measured only a distance."""
        return np.asarray(np.isfinite(self.signed_after))

    @property
    def fitted(self) -> Bools:
        """Which rows (N,) the fit used."""
        return np.asarray(~self.held_out & ~self.outlier)

    @property
    def sizes(self) -> tuple[Floats, Floats]:
        """Distances (N,) before and after, mm."""
        return np.linalg.norm(self.before, axis=1), np.linalg.norm(self.after, axis=1)


def listed(values: Any) -> Any:
    """An array as nested tuples of JSON's own numbers, rounded; None for NaN."""
    if isinstance(values, np.ndarray):
        return tuple(listed(value) for value in (values if values.ndim > 1 else values.tolist()))
    if isinstance(values, float):
        return float(f"{values:.{_DIGITS}g}") if np.isfinite(values) else None
    return values
