"""Methods of compensation on the same targets, beside their paper; and where poses and targets are in the workspace."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cellctl.formats import ModelFile, nominal_chain
from cellctl.kinematics import Bools, Floats, inverse_pose
from cellctl.records import ComputingTimesRow, ResidualsRow
from cellctl.report import (
    ACCENT,
    BEFORE,
    DASH,
    HELD_OUT,
    INK,
    ReportSection,
    Residuals,
    Run,
    fixed,
    millimetres,
    significant,
    svg_of,
)
from procedures.steps.tracker.rows import ComparedMethodsRow, TargetErrorsRow, TargetsRow

PUBLISHED = {
    "pseudo-target": ("1", "0.0539", "0.071"),
    "pseudo-target-matrix": ("2", "0.0533", "0.070"),
    "veitschegger-wu": ("3", "0.0584", "0.072"),
    "newton-raphson": ("4", "0.0533", "0.071"),
}
"""Number of the method, mean position error, mm, and mean attitude error, deg, of 20 measured targets: Stäubli TX60,
Leica AT960. The paper's table 4 with its standard deviations is lost; these means are in its text."""

_COLOURS = (ACCENT, "#2e7d32", "#7b1fa2", "#00838f", "#c62828", "#6d4c41")
_STEPS = (91, 91, 31)
"""Angles of A2, A3 and A5 between their limits, for the outline of the workspace."""
_DIRECTIONS = 60


def build(run: Run) -> Mapping[str, Any] | None:
    """Table, note and pictures."""
    row = run.state.last(ComparedMethodsRow)
    if row is None:
        return None
    times = run.state.last(ComputingTimesRow)
    microseconds = _microseconds(times, len(row.before_mm)) if times else {}
    measured, poses = run.state.last(TargetErrorsRow), run.state.last(ResidualsRow)
    workspace = Workspace.of(run.model) if run.model and run.model.robot.n == len("XYZABC") else None
    return {
        "count": len(row.before_mm),
        "measured": _measured(measured, run.state.last(TargetsRow)) if measured else None,
        "lines": list(_lines(row, microseconds)),
        "repeats": times.repeats if times else 0,
        "methods": methods_picture(row, measured, microseconds),
        "workspace": workspace and poses and workspace_picture(workspace, Residuals.of_row(poses)),
        "overlap": _overlap(workspace, Residuals.of_row(poses)) if workspace and poses else {},
    }


def _microseconds(times: ComputingTimesRow, targets: int) -> dict[str, float]:
    """Of each method, for one target."""
    return {name: 1e6 * seconds / targets for name, seconds in zip(times.what, times.seconds, strict=True)}


def _figures(errors: Floats) -> tuple[str, str, str]:
    """Mean, largest and standard deviation, mm."""
    return fixed(float(errors.mean()), 4), fixed(float(errors.max()), 4), fixed(float(errors.std(ddof=1)), 4)


def _measured(row: TargetErrorsRow, made: TargetsRow | None) -> dict[str, Any]:
    figures = _figures(np.linalg.norm(row.after, axis=1)) if len(row.number) > 1 else (DASH,) * 3
    return {"manner": made.manner if made else "the table", "figures": figures}


def _lines(row: ComparedMethodsRow, microseconds: Mapping[str, float]) -> Iterator[dict[str, Any]]:
    for each in row.methods:
        number, position, attitude = PUBLISHED.get(each.method, ("", "", ""))
        yield {
            "method": f"{each.method} ({number})" if number else each.method,
            "figures": _figures(np.array(each.error_mm)) if len(each.error_mm) > 1 else (DASH,) * 3,
            "angle": significant(float(np.mean(each.error_deg))),
            "passes": each.passes if each.converged == len(each.error_mm) else DASH,
            "time": significant(microseconds[each.method]) if each.method in microseconds else DASH,
            "published": (position, attitude),
        }


def methods_picture(
    row: ComparedMethodsRow, measured: TargetErrorsRow | None, microseconds: Mapping[str, float]
) -> str:
    """Left: share of the targets with at most each error, computed and measured; right: time for a target."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        if measured:
            for errors, colour, label in (
                (measured.before, BEFORE, "measured, before"),
                (measured.after, INK, "measured, table in force"),
            ):
                _curve(left, np.linalg.norm(errors, axis=1), colour, label)
        for each, colour in zip(row.methods, _COLOURS, strict=False):
            _curve(left, np.array(each.error_mm), colour, f"computed, {each.method}")
        left.set_xscale("log")
        millimetres(left)
        left.set(xlabel="position error, mm", ylabel="share of the targets, %", ylim=(0, 101))
        left.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        names = [each.method for each in row.methods if each.method in microseconds]
        right.barh(names, [microseconds[name] for name in names], 0.6, color=_COLOURS[: len(names)])
        right.invert_yaxis()
        right.set(xlabel="time of one pass for a target, µs")
        right.grid(axis="y", visible=False)

    return svg_of(draw, "methods", 2.9, "Errors of the targets by method of compensation, and the time of each method")


def _curve(axes: Axes, errors: Floats, colour: str, label: str) -> None:
    share = 100.0 * (np.arange(len(errors)) + 1.0) / len(errors)
    axes.step(np.sort(errors), share, where="post", color=colour, linewidth=1.3, label=label)


@final
@dataclass(frozen=True, eq=False)
class Workspace:
    """Outer limit of the TCP in the half-plane through A1's axis: distance from it and height (D, 2), mm.

    nominal, identified: of each robot in the nominal base frame, in D directions `angle` (D,), rad, about `centre`
    (2,). A2, A3 and A5 go over their limits, the other joints are at 0.
    """

    centre: Floats
    angle: Floats
    nominal: Floats
    identified: Floats

    @classmethod
    def of(cls, model: ModelFile) -> Self:
        """Of a six-axis robot."""
        limits, chain = model.robot.limits(), nominal_chain(model)
        turned = [
            np.linspace(limits[axis, 0], limits[axis, 1], steps) for axis, steps in zip((1, 2, 4), _STEPS, strict=True)
        ]
        readings = np.zeros((int(np.prod(_STEPS)), model.robot.n))
        readings[:, [1, 2, 4]] = np.stack(np.meshgrid(*turned, indexing="ij"), axis=-1).reshape(-1, 3)
        q, into_base = model.robot.joint_map().model(readings), inverse_pose(chain.base_now)
        nominal, identified = (
            _section((into_base @ poses)[:, :3, 3]) for poses in (chain.forward(q), model.robot_model().pose(q))
        )
        centre = np.array([0.0, (nominal[:, 1].max() + nominal[:, 1].min()) / 2.0])
        edges = np.linspace(-np.pi / 2.0, np.pi / 2.0, _DIRECTIONS + 1)
        away = nominal - centre
        own = np.clip(np.digitize(np.arctan2(away[:, 1], away[:, 0]), edges) - 1, 0, _DIRECTIONS - 1)
        size = np.linalg.norm(away, axis=1)
        outermost = [np.flatnonzero(own == place)[np.argmax(size[own == place])] for place in np.unique(own)]
        found = away[outermost]
        return cls(centre, np.arctan2(found[:, 1], found[:, 0]), nominal[outermost], identified[outermost])

    @property
    def apart(self) -> float:
        """The largest distance between the two limits, at the same joints, mm."""
        return float(np.linalg.norm(self.identified - self.nominal, axis=1).max())

    def inside(self, places: Floats) -> Floats:
        """By how much places (N, 3), mm, of the base frame are inside the limits of both robots (N,), mm."""
        away = _section(places) - self.centre
        limits = np.minimum(*(np.linalg.norm(each - self.centre, axis=1) for each in (self.nominal, self.identified)))
        limit = np.interp(np.arctan2(away[:, 1], away[:, 0]), self.angle, limits)
        return np.asarray(limit - np.linalg.norm(away, axis=1))


def _section(places: Floats) -> Floats:
    """Distance from A1's axis and height (N, 2), mm, of places (N, 3) in the base frame."""
    return np.column_stack([np.linalg.norm(places[:, :2], axis=1), places[:, 2]])


def _overlap(workspace: Workspace, rows: Residuals) -> dict[str, str]:
    inside = workspace.inside(rows.tip_base)
    return {
        "apart": significant(workspace.apart),
        "fit": fixed(float(inside[~rows.held_out].min()), 0),
        "held_out": fixed(float(inside[rows.held_out].min()), 0),
    }


def workspace_picture(workspace: Workspace, rows: Residuals) -> str:
    """Poses of the fit and held-out ones: beside A1's axis with the limits of both robots, and from above."""
    sets: Sequence[tuple[Bools, str, str, str]] = (
        (~rows.held_out, "o", ACCENT, "poses of the fit"),
        (rows.held_out, "D", HELD_OUT, "held-out poses, the targets"),
    )

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        left.plot(*workspace.nominal.T, color=BEFORE, linewidth=3.0, alpha=0.6, label="limit, nominal robot")
        left.plot(*workspace.identified.T, "--", color=INK, linewidth=0.9, label="limit, identified robot")
        section = _section(rows.tip_base)
        for which, marker, colour, label in sets:
            left.plot(*section[which].T, marker, color=colour, markersize=3, label=label)
            right.plot(*rows.tip_base[which, :2].T, marker, color=colour, markersize=3)
        turn, reach = np.linspace(0.0, 2.0 * np.pi, 181), workspace.nominal[:, 0].max()
        right.plot(reach * np.cos(turn), reach * np.sin(turn), color=BEFORE, linewidth=3.0, alpha=0.6)
        for axes in (left, right):
            axes.set_aspect("equal")
        left.set(xlabel="distance from A1's axis, mm", ylabel="Z of the base, mm")
        right.set(xlabel="X of the base, mm", ylabel="Y of the base, mm")
        figure.legend(loc="outside upper center", ncols=4, labelcolor=INK)

    return svg_of(draw, "workspace", 3.6, "Poses of the fit and held-out poses in the workspace of both robots")


SECTION = ReportSection(
    id="tracker-methods",
    title="Methods of compensation",
    order=22,
    needs=(ComparedMethodsRow,),
    build=build,
    template="""\
<table>
<thead><tr><th rowspan="2"></th><th colspan="3">position error, mm</th><th rowspan="2">mean angle, °</th>
<th rowspan="2">passes</th><th rowspan="2">µs</th><th colspan="2">published</th></tr>
<tr><th>mean</th><th>max</th><th>std</th><th>mm</th><th>°</th></tr></thead>
<tbody>
{% if measured %}
<tr><th>measured</th>
{% for text in measured.figures %}<td class="after">{{ text }}</td>{% endfor %}
<td colspan="5"></td></tr>
{% endif %}
<tr><th colspan="9">computed, one pass</th></tr>
{% for line in lines %}
<tr><th>{{ line.method }}</th>{% for text in line.figures %}<td>{{ text }}</td>{% endfor %}
<td>{{ line.angle }}</td><td>{{ line.passes }}</td><td>{{ line.time }}</td>
{% for text in line.published %}<td>{{ text }}</td>{% endfor %}</tr>
{% endfor %}
</tbody>
</table>
{% if measured %}
<p class="note">Measured: the {{ count }} targets with the table in force, made by {{ measured.manner }}; by one
reflector, so without their angle.</p>
{% endif %}
<p class="note">Computed: what one pass of each method leaves at the same targets, by the identified robot; errors of
model, robot and instrument are not in it. Position errors are 3-D. Passes: until every target converges.</p>
{% if repeats %}
<p class="note">µs: time of one pass for a target, with the first inverse that all methods share; of all targets at once
on the computer of the run, the least of {{ repeats }}.</p>
{% endif %}
<p class="note">Published: 20 targets of a Stäubli TX60 with a Leica AT960, measured after each method; its identified
model left 0.052 mm and 0.070°. Largest errors on an axis: less than 0.07 mm and 0.1°; the standard deviations are lost,
times are not stated. It finds methods 1 and 3 faster than 2 and 4, which invert a matrix.</p>
<figure>{{ methods | safe }}</figure>
{% if workspace %}
<figure>{{ workspace | safe }}
<figcaption>The paper's figure 8. Limit: outermost TCP over the limits of A2, A3 and A5, with A4 and A6 at 0; without
inner limits. The limits of the two robots are up to {{ overlap.apart }} mm apart. The outermost pose of the fit is
{{ overlap.fit }} mm inside both, the outermost held-out one {{ overlap.held_out }} mm.</figcaption></figure>
{% endif %}
""",
)
