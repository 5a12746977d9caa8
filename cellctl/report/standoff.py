"""The stand-off proof as the journal has it: how far each target was from where the model put it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np

from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class StandOff:
    """Stand-off targets reached with nominal joints (before) and with the table's (after).

    errors (N,): measured travel to contact less the stand-off, mm, signed; expected (N,): what the model foresaw of it,
    mm, 0 where nothing; sigma (N,): predicted 1 σ of the rest, mm, NaN where none was predicted; numbers (N,).
    """

    numbers: Floats
    errors: Floats
    expected: Floats
    sigma: Floats

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, Any]], run: str) -> Self:
        """The rows of one run, `before` or `after`, that have an error."""
        mine = [row for row in rows if row.get("run") == run and row.get("error_mm") is not None]
        sigma = [float("nan") if row.get("sigma_mm") is None else float(row["sigma_mm"]) for row in mine]
        numbers = [float(row.get("number", place)) for place, row in enumerate(mine, 1)]
        errors = [float(row["error_mm"]) for row in mine]
        expected = [float(row.get("expected_mm") or 0.0) for row in mine]
        return cls(np.array(numbers), np.array(errors), np.array(expected), np.array(sigma))

    @property
    def unforeseen(self) -> Floats:
        """What is left of the errors (N,), mm, without what the model foresaw."""
        return np.asarray(self.errors - self.expected)

    @property
    def found_sigma(self) -> float:
        """Root mean square of what was not foreseen, mm, which the predicted σ has to match; NaN without rows."""
        return float(np.sqrt(np.mean(self.unforeseen**2))) if self.errors.size else float("nan")

    @property
    def predicted_sigma(self) -> float:
        """Root mean square of the predicted σ, mm; NaN where there is none."""
        known = self.sigma[np.isfinite(self.sigma)]
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
