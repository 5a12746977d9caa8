"""How good a model is on rows that it never saw, and whether that is better than nominal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, final

import numpy as np

from cellctl.kinematics import Floats

Verdict: TypeAlias = Literal["better", "no better", "worse"]


@final
@dataclass(frozen=True, slots=True)
class ErrorFigures:
    """Mean, root mean square and greatest of a set of distances, mm; all 0 where there are none."""

    mean: float
    rms: float
    max: float

    @classmethod
    def of(cls, errors: Floats) -> ErrorFigures:
        """The figures of `errors` (N,), mm."""
        if not errors.size:
            return cls(0.0, 0.0, 0.0)
        return cls(float(errors.mean()), float(np.sqrt(np.mean(errors**2))), float(errors.max()))


def paired_verdict(nominal: Floats, identified: Floats) -> Verdict:
    """Whether the identified model's errors (N,), mm, are below nominal's on the same held-out rows.

    Paired t test on the difference of the two errors row by row, two-sided at 5 %: what both share (a far corner of
    the workspace, a noisy hour) drops out, and a gain that a few lucky rows could explain is `no better`. Fewer than
    three rows prove nothing.
    """
    from scipy.stats import t

    gain = nominal - identified
    if gain.size < 3:
        return "no better"
    bound = float(t.ppf(0.975, gain.size - 1)) * float(gain.std(ddof=1)) / np.sqrt(gain.size)
    if gain.mean() > bound:
        return "better"
    return "worse" if gain.mean() < -bound else "no better"


def verdict_sentence(verdict: Verdict, nominal: ErrorFigures, test: ErrorFigures, rows: int, kind: str) -> str:
    """One sentence for a person: how good before, how good now, on how many held-out rows of what `kind`."""
    figures = f"{nominal.mean:.3f} → {test.mean:.3f} mm mean ({nominal.max:.3f} → {test.max:.3f} max)"
    where = f"on {rows} held-out {kind}"
    match verdict:
        case "better":
            return f"Better: {figures} {where}."
        case "worse":
            return f"Worse than nominal: {figures} {where}; do not use this model."
        case _:
            return f"No better than nominal: {figures} {where}; the difference is within its own scatter."
