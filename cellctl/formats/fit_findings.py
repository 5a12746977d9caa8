"""Findings of a fit besides its figures: free groups, large deviations, figures by label, mastering."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from cellctl.formats.measurements import Measurements

if TYPE_CHECKING:
    from cellctl.calibration import FitResult

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
    import numpy as np

    from cellctl.calibration import ErrorFigures

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
    import numpy as np

    from cellctl.calibration import functions

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
    """The correction of the controller's readings of each joint whose zero was identified, deg, and its 1 σ.

    A joint that reads r is at sign · r + offset + θ. If θ is larger than before by δ, the joint reaches its assumed
    position at the reading r + sign · δ. Only where the zeros alone were free: if the links are free as well, an error
    of a link may be confused with one of a zero.
    """
    import numpy as np

    from cellctl.calibration.estimation.moved import zero_changes

    freed = measured.task.freed
    if "zeros" not in freed or freed & {"links", "geometry"}:
        return []
    change, sigma = zero_changes(measured.task, result.identification.identified)
    offsets = np.rad2deg(measured.robot.joint_map().sign * change)
    return [
        {"joint": f"A{number}", "offset_deg": offset, "sigma_deg": spread}
        for number, (offset, spread) in enumerate(zip(offsets.tolist(), np.rad2deg(sigma).tolist(), strict=True), 1)
    ]
