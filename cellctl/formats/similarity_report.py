"""The analysis of a robot's errors as plain values for JSON, and its result in sentences."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellctl.analysis import Correlation, EmpiricalSemivariogram, Similarity
    from cellctl.formats.robot_errors import RobotErrors

SIGNIFICANT = 0.05


def similarity_report(errors: RobotErrors, found: Similarity, seed: int) -> dict[str, Any]:
    """All figures. Distances in mm and degrees, semivariances in variances; None for what cannot be computed."""
    import numpy as np

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
    return words


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
