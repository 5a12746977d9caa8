"""The verification: stand-offs from a sphere that was not used for calibration, before and after."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np

from cellctl.kinematics import Floats
from cellctl.report import (
    Contribution,
    ReportSection,
    Run,
    Sigma,
    before_and_after,
    error_line,
    one_by_one,
    percent,
    significant,
)
from procedures.steps.sphere.rows import LocateRow, ProofRow, SphereVerdict, StandOffRow


@final
@dataclass(frozen=True, eq=False)
class StandOffErrors:
    """N stand-offs. numbers (N,): of the targets. errors (N,): travel to contact less intended distance, mm, signed.

    predicted (N,): error predicted by the model; sigma (N,): 1 σ of the rest, mm.
    """

    numbers: Floats
    errors: Floats
    predicted: Floats
    sigma: Floats

    @classmethod
    def of(cls, rows: Sequence[StandOffRow], run: str) -> Self:
        """The rows of one run, `before` or `after`."""
        mine = [row for row in rows if row.run == run]
        columns = ([row.number for row in mine], [row.error_mm for row in mine])
        known = ([row.expected_mm for row in mine], [row.sigma_mm for row in mine])
        return cls(*(np.array(column, float) for column in (*columns, *known)))

    @property
    def rest(self) -> Floats:
        """The errors (N,), mm, less their prediction."""
        return np.asarray(self.errors - self.predicted)

    @property
    def found_sigma(self) -> float:
        """RMS of `rest`, mm, to be compared with the predicted σ; NaN without rows."""
        return _rms(self.rest)

    @property
    def predicted_sigma(self) -> float:
        """RMS of the predicted σ, mm; NaN without rows."""
        return _rms(self.sigma)

    @property
    def within_two_sigma(self) -> float | None:
        """Share of `rest` within ±2 predicted σ; None without rows."""
        return float(np.mean(np.abs(self.rest) <= 2.0 * self.sigma)) if self.errors.size else None


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def build(run: Run) -> Mapping[str, Any]:
    """Pictures, and observed against predicted errors."""
    rows = run.state.recorded(StandOffRow)
    before, after = StandOffErrors.of(rows, "before"), StandOffErrors.of(rows, "after")
    proof = run.state.last(ProofRow)
    each = ""
    if after.errors.size:
        each = one_by_one("targets", after.numbers, after.errors, after.sigma, "error")
    return {
        "sentences": list(_sentences(rows[0].sphere, len(run.state.recorded(LocateRow)), before, after)),
        "picture": before_and_after("standoff", before.errors, after.errors, "stand-off error"),
        "each": each,
        "centre": _centre(proof) if proof else None,
    }


def _sentences(sphere: str, located: int, before: StandOffErrors, after: StandOffErrors) -> Iterator[str]:
    yield f"Sphere {sphere} was not used for calibration."
    if located:
        yield f"{located} touches located its centre with the model under test."
    yield "The error is the travel to contact less the stand-off."
    yield (
        f"{len(before.errors)} targets with nominal joints, {len(after.errors)} with the controller's table in force."
    )
    if after.errors.size:
        found, predicted = after.found_sigma, after.predicted_sigma
        yield (
            f"After: found {significant(found)} mm RMS where {significant(predicted)} mm was predicted "
            f"(ratio {significant(found / predicted)}); {percent(after.within_two_sigma)} lie within 2 σ."
        )
    if before.predicted.any():
        off = significant(before.found_sigma)
        yield f"Before: the identified model predicted each error of the nominal robot to {off} mm RMS."


def _centre(proof: ProofRow) -> tuple[str, str, str]:
    """Distance between the centres by the two models; RMS of the touches that located it, before and after, mm."""
    apart = np.linalg.norm(np.subtract(proof.nominal_centre, proof.identified_centre))
    sizes = [np.sqrt(np.mean(np.square(each))) for each in (proof.nominal_residuals, proof.identified_residuals)]
    return significant(float(apart)), significant(float(sizes[0])), significant(float(sizes[1]))


def error_lines(run: Run) -> Sequence[Mapping[str, Any]]:
    """Stand-off targets before and after, from the verdict."""
    verdict = run.state.last(SphereVerdict)
    found = verdict.standoff if verdict else None
    if found is None or not found.n:
        return []
    before, after = vars(found.before), vars(found.after)
    return [error_line("stand-off targets", found.n, before, after, found.predicted_sigma)]


def contributions(run: Run) -> list[Contribution]:
    """The centre of the proof sphere, which every stand-off error refers to.

    Of n touches from all sides, each with scatter s: s · √(3 / n) in any direction; s from the residuals and n − 3
    degrees of freedom.
    """
    proof = run.state.last(ProofRow)
    number = len(proof.identified_residuals) if proof else 0
    if proof is None or number <= 3:
        return []
    scatter = np.sqrt(np.sum(np.square(proof.identified_residuals)) / (number - 3))
    what, source = f"centre of sphere {proof.sphere}", f"{number} touches that located it"
    return [Contribution(what, "A", source, error_mm=float(scatter * np.sqrt(3.0 / number)))]


def errors(run: Run) -> Sequence[float]:
    """Of the stand-offs with the table in force, without sign."""
    return [abs(row.error_mm) for row in run.state.recorded(StandOffRow) if row.run == "after"]


SECTION = ReportSection(
    id="sphere-standoffs",
    title="Proof by stand-offs",
    order=20,
    needs=(StandOffRow,),
    build=build,
    error_lines=error_lines,
    contributions=contributions,
    errors=errors,
    sigmas=(
        Sigma(
            "predicted σ of a stand-off",
            "the error along the normal at one target, less what the model predicts of it",
            "covariance of the parameters, of the sphere's centre, and the scatter of a touch",
            "1 σ, along one line; the share within ±2 σ should be about 95 %",
        ),
    ),
    template="""\
<p>{{ sentences | join(" ") }}</p>
{% if centre %}
<p>The two models place the centre {{ centre[0] }} mm apart. The touches that located it are off by
{{ centre[1] }} mm RMS by the nominal robot, {{ centre[2] }} mm RMS by the identified one.</p>
{% endif %}
<figure>{{ picture | safe }}</figure>
{% if each %}
<figure>{{ each | safe }}</figure>
{% endif %}
""",
)
