"""The result of a fit: its findings, JSON of `cellctl fit` and of a campaign, and the verdict in sentences."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from cellctl.calibration import MOVED, ErrorFigures, FitResult, functions, verdict_sentence
from cellctl.calibration.identification.moved import Placing, zero_changes
from cellctl.formats.measurements import Measurements

WIDE = 3.0
"""A parameter this many tolerances from the robot file's is reported."""


def free_groups(result: FitResult) -> list[str]:
    """Groups with any free parameter, in the order of the parameters."""
    unknowns = result.identification.identified.unknowns
    pairs = zip(unknowns.groups, unknowns.free, strict=True)
    return list(dict.fromkeys(group for group, is_free in pairs if is_free))


def sessions(measured: Measurements) -> list[dict[str, Any]]:
    """Each session of the data set with its rows and its own groups; none where the file names none."""
    of_rows = measured.texts("session")
    own = {session.name: sorted(session.own) for session in measured.task.sessions}
    return [
        {"name": name, "rows": of_rows.count(name), "own": own.get(name, [])} for name in dict.fromkeys(of_rows) if name
    ]


def by_label(result: FitResult, labels: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Figures of the held-out rows of each label; labels: one for each row, none where rows were held out at random."""
    of_rows, found = np.array(labels), {}
    for label in dict.fromkeys(labels):
        mine = of_rows == label
        columns = {
            "nominal": result.nominal_errors,
            "nominal_with_tool": result.nominal_with_tool_errors,
            "prior": result.prior_errors,
            "test": result.test_errors,
        }
        figures = {
            name: None if errors is None else asdict(ErrorFigures.of(errors[mine])) for name, errors in columns.items()
        }
        found[label] = {"rows": int(mine.sum()), **figures}
    return found


def wide(result: FitResult) -> list[dict[str, Any]]:
    """Parameters of robot and tool further than `WIDE` tolerances from the robot file's, with their σ, without
    coefficients of random functions.
    """
    found = result.identification.identified
    unknowns, model = found.unknowns, found.state.model
    sigma, tolerances = np.sqrt(np.diag(found.covariance)), result.identification.nominal.unknowns.sigma
    lengths = {"mm": 1000.0, "rad": 1.0}  # a prior of a thousand millimetres or a radian is flat
    others = {"base", *functions()}
    return [
        {
            "name": each.name,
            "value": value,
            "unit": each.unit.name,
            "sigma": float(after),
            "tolerance": float(before),
        }
        for each, value, is_free, before, after in zip(
            model.parameters,
            model.deviations.tolist(),
            unknowns.free,
            tolerances,
            sigma,
            strict=False,
        )
        if is_free
        and each.group not in others
        and before < lengths.get(each.unit.name, np.inf)
        and abs(value) > WIDE * before
    ]


def mastering(measured: Measurements, result: FitResult) -> list[dict[str, Any]]:
    """The correction of the controller's readings of each joint whose zero was identified, deg, and its 1 σ; mm of a
    prismatic joint.

    A joint that reads r is at sign · r + offset + θ. If θ is larger than before by δ, the joint reaches its assumed
    position at the reading r + sign · δ. Only where the zeros alone were free: if the links are free as well, an error
    of a link may be confused with one of a zero.
    """
    freed = measured.task.free_groups
    if "zeros" not in freed or freed & {"links", "geometry"}:
        return []
    change, sigma = zero_changes(measured.task, result.identification.identified)
    joints = measured.robot.joint_map()
    rows = zip((joints.sign * change).tolist(), sigma.tolist(), joints.units, strict=True)
    return [
        {"joint": f"A{number}", "offset_mm": offset, "sigma_mm": spread}
        if unit == "mm"
        else {"joint": f"A{number}", "offset_deg": float(np.rad2deg(offset)), "sigma_deg": float(np.rad2deg(spread))}
        for number, (offset, spread, unit) in enumerate(rows, 1)
    ]


_LINES = 5


NOISY = 1.5
"""From this noise scale on the verdict reports it."""


def fit_report(measured: Measurements, result: FitResult, labels: Sequence[str] = ()) -> dict[str, Any]:
    """The result's figures with outliers and rejected rows by line; the caller adds the time it took.

    outliers: rows left out of the fit; test_outliers: held-out rows far beyond the predicted error, kept in the
    figures. labels: of the held-out rows, one by one, if figures are needed for each (`by`).
    """
    return {
        **result.summary(),
        "measure": measured.measure,
        "nominal_geometry": measured.robot.geometry_source,
        "groups": free_groups(result),
        "sessions": sessions(measured),
        "by": by_label(result, labels),
        "wide": wide(result),
        "mastering": mastering(measured, result),
        "outliers": _named(measured, result.identification.outliers, lambda row: _far_out(measured, result, row)),
        "test_outliers": _named(measured, result.unpredicted, lambda row: _unpredicted(measured, result, row)),
        "rejected": [{"line": row.line, "reason": row.reason} for row in measured.rejected],
        "sentence": sentence(measured, result),
    }


def sentence(measured: Measurements, result: FitResult) -> str:
    """The verdict, with the figures that qualify it: σ over the region, scatter, held-out outliers."""
    kind, reason = measured.noun, result.verdict_reason
    if not result.n_test:
        mean = f"{result.fit.mean:.3f} mm (mean of {result.n_fit})"
        verdict = f"Error of the {kind} of the fit: {mean}. Not proved: no {kind} were held out."
    else:
        verdict = verdict_sentence(
            result.verdict,
            result.nominal_with_tool or result.nominal,
            result.test,
            result.n_test,
            kind,
            reason,
            prior=result.prior,
            against=result.against,
            with_tool=result.nominal_with_tool is not None,
        )
    return " ".join([verdict, *(f"{each}." for each in _besides(measured, result))])


def _besides(measured: Measurements, result: FitResult) -> list[str]:
    kind, noise = measured.noun, float(result.identification.noise.max())
    if np.isnan(result.predicted_volumetric_rms):
        sentences = ["σ: none, as this model states none"]
    else:
        sentences = [f"1 σ over {result.predicted_over}: {result.predicted_volumetric_rms:.3f} mm"]
    if measured.robot.calibration is not None:
        sentences.append(f"Nominal is the {measured.robot.geometry_source}, not the data sheet")
    if result.sigma_ok is False:
        sentences.append(f"Do not rely on σ: {result.sigma_reason}")
    if result.placing and result.placing.moved:
        sentences.append(_moved(result.placing))
    if place := _tool_held(measured, result):
        what = f"{place.with_both_mm:.3f} mm RMS in place of {place.with_base_mm:.3f}"
        sentences.append(f"The tool changed too: --free base,tool explains the rows ({what})")
    if _base_held_elsewhere(measured, result):
        sentences.append("The prior model does not fit where it was: if the instrument was moved, leave --free out")
    if noise >= NOISY:
        sentences.append(
            f"The {kind} scatter {noise:{'.0f' if noise >= 10.0 else '.1f'}} times more than {_promise(measured)}"
        )
    if noise >= NOISY and measured.task.prior is None and "geometry" not in result.model.split("+"):
        sentences.append("The model has no links: their errors count as scatter, which is in this σ")
    if measured.task.prior is not None and measured.task.groups is None and result.identification.prior_scale:
        sentences.append(_changed(result.identification.prior_scale))
    if result.unpredicted:
        lines = [str(line) for line in sorted(measured.lines[row] for row in result.unpredicted)]
        where = f"{', '.join(lines[:_LINES])}{', …' if len(lines) > _LINES else ''}"
        sentences.append(f"Outliers by the predicted error among the held-out {kind}: {len(lines)} (line {where})")
    return sentences


def _moved(place: Placing) -> str:
    """What was set up anew since the prior model: an instrument at another place is no change of the robot."""
    match place.changed:
        case "base":
            by = f"base {place.base_mm:.1f} mm and {place.base_deg:.2f}° from there"
            return f"Instrument moved since the prior model: it was set up again ({by}); the tool is as it was"
        case "tool":
            return f"The tool changed since the prior model ({place.as_is_mm:.3f} mm RMS)"
        case _:
            return f"Instrument or robot, and tool, moved since the prior model ({place.as_is_mm:.3f} mm RMS)"


def _tool_held(measured: Measurements, result: FitResult) -> Placing | None:
    """Where the tool was held in partial work that failed, although base and tool together explain the rows."""
    task, place = measured.task, result.placing
    held = (
        task.is_partial_update
        and "base" in task.free_groups
        and "tool" not in task.free_groups
        and result.verdict != "better"
    )
    return place if held and place is not None and place.tool_too else None


def _base_held_elsewhere(measured: Measurements, result: FitResult) -> bool:
    """Whether the base was held in partial work that failed, although registering nominal leaves far less."""
    task, place = measured.task, result.placing
    held = task.is_partial_update and "base" not in task.free_groups and result.verdict != "better"
    return held and place is not None and place.as_is_mm >= MOVED * result.nominal.rms


def _changed(prior_scale: Mapping[str, float]) -> str:
    """Message on a robot that has changed since its prior model: by how much, and what to do."""
    by = ", ".join(f"{group} × {factor:{'.0f' if factor >= 10.0 else '.1f'}}" for group, factor in prior_scale.items())
    again = f"if something hit the robot, or was exchanged, fit again with --free {','.join(prior_scale)}"
    return f"The robot is further from the prior model than the model's σ allows: {by} ({again})"


def _promise(measured: Measurements) -> str:
    return "the data set states" if measured.own_sigma else "the robot file states"


def _named(measured: Measurements, rows: Sequence[int], reason: Callable[[int], str]) -> list[dict[str, Any]]:
    """Rows by line, each with its reason."""
    named = [{"line": measured.lines[row], "reason": reason(row)} for row in rows]
    return sorted(named, key=lambda row: int(row["line"]))


def _far_out(measured: Measurements, result: FitResult, row: int) -> str:
    error = _error(measured, result, row)
    return f"error {error:.3f} mm, the others {result.fit.rms:.3f} mm (RMS): an outlier, left out of the fit"


def _unpredicted(measured: Measurements, result: FitResult, row: int) -> str:
    place = result.unpredicted.index(row)
    error, predicted = result.unpredicted_mm[place], result.predicted_mm[place]
    return f"held out: error {error:.3f} mm, predicted {predicted:.3f} mm (1 σ): an outlier, counted in the figures"


def _error(measured: Measurements, result: FitResult, row: int) -> float:
    return float(measured.task.rows.pick([row]).errors(result.identification.identified.state)[0])
