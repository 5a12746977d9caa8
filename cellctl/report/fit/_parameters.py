"""The parameters of a fit: table with σ before and after, estimated places, and pairs hardly determined separately."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cellctl.calibration import Parameter, Unknowns, functions, kinds, plane_estimates
from cellctl.formats import RobotFile
from cellctl.kinematics import Bools, Floats, abc_from_rotation
from cellctl.report.figures import DASH, MINUS, fixed, significant, with_sigma
from cellctl.report.fit._story import FitStory

LONG = 20
"""A group of more parameters than this is folded until the reader opens it."""

_FRAME = "xyzabc"
_TITLES = {
    "base": "Base",
    "tool": "Tool",
    "zeros": "Joint zeros",
    "links": "Links",
}


@final
@dataclass(frozen=True, slots=True)
class Line:
    """One parameter, as texts. in_assumed_sigmas, in_sigmas: its deviation in its σ before, and after, the rows.

    share: 1 − σ²/assumed σ², the part of the knowledge of it that comes from the rows; the assumed σ is scaled
    if the data show that it is too small. wide: its deviation is above three assumed σ.
    """

    label: str
    unit: str
    nominal: str
    deviation: str
    assumed_sigma: str
    in_assumed_sigmas: str
    in_sigmas: str
    share: float
    wide: bool

    @property
    def decided_by(self) -> str:
        """Its source: the `data`, the assumed `σ`, or `both`."""
        return "data" if self.share > 0.9 else "both" if self.share > 0.1 else "σ"


@final
@dataclass(frozen=True, slots=True)
class Group:
    """Parameters of one kind."""

    title: str
    lines: tuple[Line, ...]

    @property
    def folded(self) -> bool:
        """Whether there are too many to show unfolded."""
        return len(self.lines) > LONG


def known_before(story: FitStory) -> Floats:
    """Assumed 1 σ of each parameter (P,) before the rows, scaled if the data show that it is too small."""
    return _sigma(story.found.unknowns)


def _sigma(unknowns: Unknowns) -> Floats:
    return unknowns.sigma if unknowns.prior is None else np.sqrt(np.diag(unknowns.prior))


def found_anew(story: FitStory) -> Bools:
    """Which parameters (P,) have no prior: points, and base and tool in an instrument's frame."""
    unknowns, tolerances = story.found.unknowns, story.task.tolerances
    place = unknowns.among(frozenset({"base", "tool", "points", "datums"}))
    return np.asarray(place & (known_before(story) >= min(tolerances.flat_rad, tolerances.flat_mm)))


def groups(story: FitStory) -> list[Group]:
    """The free parameters of the robot in its first session, by kind, without those without assumed σ (`places`)
    and without the coefficients of random functions (`coefficients`).
    """
    unknowns = story.found.unknowns
    shown = (
        unknowns.free
        & ~unknowns.among(functions())
        & ~found_anew(story)
        & (np.arange(len(unknowns.names)) < unknowns.robot)
    )
    lines: dict[str, list[int]] = {}
    for index in np.flatnonzero(shown).tolist():
        lines.setdefault(unknowns.groups[index], []).append(index)
    titles = _TITLES | {group: kind.title for group, kind in kinds().items()}
    ordered = [group for group in titles if group in lines]
    return [Group(titles[group], tuple(_line(story, index) for index in lines[group])) for group in ordered]


def coefficients(story: FitStory) -> dict[str, int]:
    """Number of coefficients of each random function."""
    groups = story.found.unknowns.groups
    return {group: groups.count(group) for group in sorted(functions() & set(groups))}


def held(story: FitStory) -> list[str]:
    """The robot's parameters that were held."""
    unknowns = story.found.unknowns
    return [unknowns.parameters[index].label for index in np.flatnonzero(~unknowns.free) if index < unknowns.robot]


def _line(story: FitStory, index: int) -> Line:
    found, model = story.found, story.found.state.model
    parameter = found.unknowns.parameters[index]
    factor = parameter.unit.factor
    before = _before(story, parameter)
    change = (float(model.deviations[index]) - before) * factor
    sigma = float(np.sqrt(max(found.covariance[index, index], 0.0))) * factor
    before_it = float(known_before(story)[index]) * factor
    assumed = float(_sigma(story.result.identification.nominal.unknowns)[index]) * factor
    return Line(
        label=parameter.label,
        unit=parameter.unit.shown,
        nominal=f"{table_value(story.robot, parameter) + before * factor:.8g}".replace("-", MINUS),
        deviation=with_sigma(change, sigma),
        assumed_sigma=significant(assumed),
        in_assumed_sigmas=_times(change, assumed),
        in_sigmas=_times(change, sigma),
        share=1.0 - (sigma / before_it) ** 2 if before_it else 0.0,
        wide=abs(change) > 3.0 * assumed,
    )


def _before(story: FitStory, parameter: Parameter) -> float:
    """The deviation of this parameter in the prior model, in its own unit."""
    return story.task.model.amount(parameter.name) or 0.0


def _times(change: float, sigma: float) -> str:
    return fixed(change / sigma, 1) if sigma > 0.0 else DASH


def table_value(robot: RobotFile, parameter: Parameter) -> float:
    """The value of a parameter in the robot file, mm or degrees; 0 if the file has none (an effect, an axis)."""
    if parameter.group in ("base", "tool"):
        place = robot.tool if parameter.group == "tool" else robot.base
        return (*place.xyz, *place.abc)[_FRAME.index(parameter.axis)]
    if not parameter.column or parameter.joint > len(robot.links):
        return 0.0
    return float(getattr(robot.links[parameter.joint - 1], parameter.column) or 0.0)


Section = dict[str, Any]

MANY = 24
"""More points than this are folded until the reader opens them."""


def points(story: FitStory) -> list[Section]:
    """Each sphere or socket with its σ; marks those without a row of the fit."""
    found = story.found
    sigma = np.sqrt(np.maximum(np.diag(found.covariance)[found.state.of_points], 0.0)).reshape(-1, 3)
    visits = _counts(story, "point", len(story.task.points))
    return [
        {
            "name": name,
            "visits": int(visits[index]),
            "xyz": [fixed(float(value), 3) for value in found.state.points[index]],
            "sigma": [significant(float(value)) if visits[index] else "" for value in sigma[index]],
        }
        for index, name in enumerate(story.task.points)
        if index not in story.task.planes
    ]


def planes(story: FitStory) -> list[Section]:
    """Each plane with its σ; marks those without a row of the fit."""
    visits = _counts(story, "point", len(story.task.points))
    return [
        {
            "name": story.task.points[plane.point],
            "visits": int(visits[plane.point]),
            "normal": [fixed(float(value), 5) for value in plane.normal],
            "offset": fixed(plane.offset_mm, 3),
            "sigma": significant(plane.sigma_mm),
            "tilt": significant(plane.tilt_sigma_deg),
        }
        for plane in plane_estimates(story.task, story.found)
    ]


def datums(story: FitStory) -> list[Section]:
    """The zero offset of each instrument of unknown zero, with its σ; none without a row of the fit."""
    found, rows = story.found, _counts(story, "zeros", len(story.task.datums))
    sigma = np.sqrt(np.maximum(np.diag(found.covariance)[found.state.datums_at :], 0.0))
    return [
        {"name": name, "rows": int(rows[at]), "mm": fixed(float(value), 3), "sigma": significant(float(sigma[at]))}
        for at, (name, value) in enumerate(zip(story.task.datums, found.state.datums, strict=True))
        if rows[at]
    ]


def _counts(story: FitStory, column: str, count: int) -> Any:
    """Number of rows of the fit for each number (`count`,) in a column of their blocks."""
    blocks = story.task.rows.pick(story.used).blocks
    numbers = np.concatenate([np.zeros(0, int), *(getattr(block, column, np.zeros(0, int)) for block in blocks)])
    return np.bincount(numbers[numbers >= 0].astype(int), minlength=count)


def placements(story: FitStory) -> list[Section]:
    """Base and tool of each session, if estimated: pose, σ of position and of rotation."""
    found, anew = story.found, found_anew(story) & story.found.unknowns.free
    parameters = story.found.state.model.parameters
    rows, shown = [], set()
    for number, model in enumerate(found.state.models):
        columns = found.state.columns[number]
        for frame, pose in (("base", model.chain.base_now), ("tool", model.chain.tool_now)):
            own = [column for column, each in zip(columns, parameters, strict=True) if each.group == frame]
            if anew[own].any() and tuple(own) not in shown:
                shown.add(tuple(own))
                session = story.sessions[number] if len(found.state.models) > 1 else ""
                rows.append(_placement(session, frame, pose, found.covariance[np.ix_(own, own)]))
    return rows


def _placement(session: str, frame: str, pose: Floats, covariance: Floats) -> Section:
    """Translations rotated from the frame's own axes, along which they are parameters, to the axes of its place."""
    turn = pose[:3, :3]
    place = np.sqrt(np.maximum(np.diag(turn @ covariance[:3, :3] @ turn.T), 0.0))
    turned = float(np.rad2deg(np.sqrt(max(np.trace(covariance[3:, 3:]), 0.0))))
    return {
        "session": session,
        "frame": frame,
        "xyz": [fixed(float(value), 3) for value in pose[:3, 3]],
        "sigma": [significant(float(value)) for value in place],
        "abc": [fixed(float(value), 3) for value in np.atleast_1d(abc_from_rotation(turn))],
        "turned": significant(turned) if turned else "",
    }


def correlation(story: FitStory) -> tuple[list[str], Floats]:
    """Symbols (F,) and correlation matrix (F, F) of the robot's free parameters, including its places.
    Coefficients of random functions are left out.
    """
    unknowns, covariance = story.found.unknowns, story.found.covariance
    places = np.arange(len(unknowns.names)) >= story.found.state.points_at
    free = np.flatnonzero(unknowns.free & ~unknowns.among(functions()) & ~places & (np.diag(covariance) > 0.0))
    sigma = np.sqrt(np.diag(covariance)[free])
    return [unknowns.parameters[index].label for index in free], covariance[np.ix_(free, free)] / np.outer(sigma, sigma)
