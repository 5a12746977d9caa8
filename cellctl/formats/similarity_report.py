"""`cellctl analyse`: errors of the registered robot, and their analysis as values for JSON and in sentences."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, final

import numpy as np

from cellctl.analysis import Correlation, ErrorSet, Similarity, UnsuitableRows
from cellctl.calibration import State
from cellctl.calibration.identification.identify import inliers_among, registered
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.error_maps.kriging import EmpiricalSemivariogram
from cellctl.files import InputError, Problem
from cellctl.formats._prior import from_prior
from cellctl.formats.dataset import DataSet, Rejected
from cellctl.formats.measurements import Measurements, measurements, refuse_alike
from cellctl.formats.model import ModelFile
from cellctl.kinematics import Bools, Floats
from cellctl.robot_file import RobotFile

FAR = 6.0
"""Distance from the middle of all errors, in medians of that distance: 9 σ of errors that are normal in 3-D."""


@final
@dataclass(frozen=True, eq=False)
class RobotErrors:
    """The errors, and what was left out. total: usable rows; sampled: rows looked at; outliers: lines left out;
    apart: outliers where these were too many to leave out.
    """

    found: ErrorSet
    total: int
    sampled: int
    outliers: tuple[int, ...]
    apart: int
    rejected: tuple[Rejected, ...]


def rows_with_positions(robot: RobotFile, data: DataSet) -> Measurements:
    """The rows with a measured position. Raises InputError where there are too few, or all are at one place."""
    measured = measurements(robot, data, measure="position", model="geometry")
    refuse_alike(measured)
    return measured


def robot_errors(
    measured: Measurements, model: ModelFile | None = None, file: str = "", most: int = 300, seed: int = 0
) -> RobotErrors:
    """Measured less nominal position at the rows, base and tool registered, in the robot's base frame.

    model: identified robot in place of nominal; file: its name in errors. most: of more rows, a random sample of so
    many is used. Left out are rows that are outliers for a geometric fit and also FAR away from the middle of all
    errors: what geometry alone does not explain is to be analysed. Raises InputError where the rows do not allow it.
    """
    measured.robot.refuse_prismatic(measured.data.file, "an analysis of similarity")
    total = len(measured.lines)
    chosen = np.sort(np.random.default_rng([seed, 32]).permutation(total)[:most])
    task, rows = measured.task, measured.task.rows.pick(chosen)
    kept, apart = inliers_among(task, rows)
    kept |= ~_far(np.concatenate(_errors(rows, registered(task, rows.pick(kept)).state)[1]), kept)
    task = from_prior(measured, model, (), file).task if model else task
    inliers = rows.pick(kept)
    try:
        places, errors = map(np.concatenate, _errors(inliers, registered(task, inliers).state))
        found = ErrorSet.of(measured.readings[chosen[kept]], places, errors)
    except UnsuitableRows as error:
        what, _, cure = str(error).partition(": ")
        raise InputError(Problem(measured.data.file, 0, 0, what, cure)) from error
    left_out = tuple(measured.lines[row] for row in chosen[~kept])
    return RobotErrors(found, total, len(chosen), left_out, apart, measured.rejected)


def _far(errors: Floats, kept: Bools) -> Bools:
    """Which errors (N, 3) are FAR away from the middle of all: in distances of a typical one of those `kept`."""
    away = np.linalg.norm(errors - np.median(errors[kept], axis=0), axis=1)
    return np.asarray(away > FAR * np.median(away[kept]))


def _errors(rows: RowBlocks, state: State) -> tuple[list[Floats], list[Floats]]:
    """Nominal TCPs and errors, block after block, each turned into the base frame of its session."""
    places, errors = [], []
    for block in (each for each in rows.blocks if len(each)):
        model = state.models[block.session]
        base = model.chain.base_now
        places.append((model.tcp(block.postures) - base[:3, 3]) @ base[:3, :3])
        errors.append(-block.deviation(state)[:, :3] @ base[:3, :3])
    return places, errors


SIGNIFICANT = 0.05
LEAST_RISE = 1.0
"""Of the variance of the errors. White noise of 200 rows rises by up to 0.6 by chance, a straight slope by 6."""


def similarity_report(errors: RobotErrors, found: Similarity, seed: int) -> dict[str, Any]:
    """All figures. Distances in mm and degrees, semivariances in variances; None for what cannot be computed."""
    size = np.linalg.norm(errors.found.errors, axis=1)
    return {
        "rows": errors.total,
        "sampled": errors.sampled,
        "postures": len(errors.found),
        "repeats": errors.found.repeats,
        "pairs": len(found.de),
        "outliers": list(errors.outliers),
        "apart": errors.apart,
        "rejected": [{"line": row.line, "reason": row.reason} for row in errors.rejected],
        "still_joints": [f"A{joint}" for joint, moves in enumerate(errors.found.moving, 1) if not moves],
        "constant": [name for name, varies in zip("xyz", errors.found.varying, strict=True) if not varies],
        "error": {"mean": float(size.mean()), "rms": float(np.sqrt(np.mean(size**2))), "max": float(size.max())},
        "seed": seed,
        "correlation": {
            part: {space: _plain(each) for space, each in spaces.items()} for part, spaces in found.correlation.items()
        },
        "semivariogram": {name: _variogram(each) for name, each in found.overall.items()},
        "by_joint": {
            name: {f"A{joint}": _variogram(each) for joint, each in joints.items()}
            for name, joints in found.by_joint.items()
        },
        "by_joint_near": {
            name: {f"A{joint}": _variogram(each) for joint, each in joints.items()}
            for name, joints in found.by_joint_near.items()
        },
    }


def result_sentences(report: dict[str, Any]) -> list[str]:
    """What the correlations show, and what was left out."""
    spaces = report["correlation"]["3-D"]
    words = [f"{_related(spaces['Dq'], 'the joints')} {_related(spaces['Dp'], 'the positions')}"]
    if report["sampled"] < report["rows"]:
        words.append(f"{report['sampled']} of {report['rows']} rows, chosen at random, are analysed (--rows).")
    if report["repeats"]:
        words.append(f"{report['repeats']} rows repeat a posture: each posture's rows are averaged.")
    if report["outliers"]:
        lines = ", ".join(map(str, report["outliers"][:10])) + (", …" if len(report["outliers"]) > 10 else "")
        several = f"{len(report['outliers'])} outliers" if len(report["outliers"]) > 1 else "an outlier"
        words.append(f"Left out as {several}: line {lines}.")
    if report["apart"]:
        words.append(
            f"{report['apart']} rows do not fit together with the others; too many to leave out: all are used."
        )
    if report["still_joints"]:
        words.append(f"{', '.join(report['still_joints'])} never moves: it has no semivariogram.")
    if report["constant"]:
        words.append(f"The error along {', '.join(report['constant'])} is constant: it has no semivariogram.")
    still_rising = [
        *(f"{name} (range {_range(each):.3g})" for name, each in report["semivariogram"].items() if _rises(each)),
        *(
            f"{name} over {joint} (range {_range(each):.3g})"
            for name, joints in report["by_joint"].items()
            for joint, each in joints.items()
            if _rises(each)
        ),
    ]
    if still_rising:
        words.append(
            "These semivariograms still rise at the greatest distance, so range and sill are not determined, only "
            f"sill / range²: {', '.join(still_rising)}."
        )
    return words


def _range(semivariogram: dict[str, Any]) -> float:
    """Range of the model; NaN without a model or a sill."""
    found = (semivariogram["model"] or {}).get("range")
    return math.nan if found is None else float(found)


def _rises(semivariogram: dict[str, Any]) -> bool:
    """Whether γ rises, and does not reach its sill within the distances of the pairs.

    Then γ(h) ≈ nugget + 3 sill (h / range)²: the pairs determine sill / range² alone. Without this remark a range of 23
    and a sill of 19.6 for errors of unit variance look like a result.
    """
    found = _range(semivariogram)
    greatest = semivariogram["centre"][-1]
    if math.isnan(found) or found <= greatest:
        return False
    return bool(semivariogram["model"]["sill"] * (1.0 - math.exp(-3.0 * (greatest / found) ** 2)) > LEAST_RISE)


def p_text(p: float) -> str:
    """A p-value in words of a table; the smallest doubles are shown as a bound."""
    return "< 1e-300" if p < 1e-300 else f"{p:.3f}" if p >= 0.0995 else f"{p:.2g}"


def _related(each: dict[str, Any], what: str) -> str:
    if each["r"] is None:
        return f"Over the distance of {what} there is no correlation: all distances are equal."
    numbers = f"(r = {each['r']:.3f}, Mantel p = {p_text(each['p'])})"
    if each["p"] > SIGNIFICANT:
        return f"No relation of the errors to the distance of {what} is shown {numbers}."
    more = "differ more" if each["r"] > 0 else "differ less"
    return f"The errors {more} where the distance of {what} is larger {numbers}."


def _plain(each: Correlation) -> dict[str, Any]:
    return {name: _number(value) for name, value in asdict(each).items()}


def _variogram(each: EmpiricalSemivariogram) -> dict[str, Any]:
    bins = {name: [_number(value) for value in getattr(each, name).tolist()] for name in ("centre", "gamma")}
    model = {name: _number(value) for name, value in asdict(each.model).items()} if each.model else None
    return {**bins, "pairs": [int(count) for count in each.pairs.tolist()], "model": model}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
