"""What is charted of each robot of a fleet: which runs and parameters, about which reference, with which σ."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from itertools import groupby
from pathlib import Path
from typing import Any, Final, final

import numpy as np

from cellctl.calibration.model.parameter import FRAMES
from cellctl.files import InputError
from cellctl.formats import ModelFile
from cellctl.kinematics import Floats
from cellctl.kinematics.low_discrepancy import spread_over
from cellctl.metrology.drift_charts import (
    BASELINE,
    DriftCharts,
    alarm_limit,
    drift_charts,
    noise_scale,
    scale_error,
    squared_differences,
)
from cellctl.operations.run_indexing import MODEL, instant
from cellctl.operations.table_history import histories
from cellctl.run_index import RunIndex

HORIZON: Final = timedelta(days=5 * 365.25)
"""In this time a robot without a change has at most one false alarm on average."""

DETERMINED: Final = 0.5
"""A parameter is charted if the rows of the calibration made its σ smaller than so many times that before them. A fit
shows at least three quarters of a change of such a parameter; the prior takes the rest."""

LEAST_RUNS_A_YEAR: Final = 12.0
"""A robot that was measured less often than monthly, or for less than a month, has limits as if it were."""

_LAST: Final = 30
"""Number of the last runs that are read of each robot: all older ones together have 0.1 % of the EWMA's weight."""

_LEAST_DIFFERENCES: Final = 20
"""Below this number of differences from run to run the scatter does not say what σ is."""

_SURE: Final = 5.0
"""A stated σ is called too small if the scatter exceeds it by so many σ of the scatter's own estimate."""

_POSTURES: Final = 64


@final
@dataclass(frozen=True, slots=True)
class SmallSigma:
    """A parameter whose stated σ is too small: the scatter from run to run is `scale` times it. serial: of one robot;
    empty: of all robots of the type together. differences: how many it is from. Its charts use the scatter.
    """

    type: str
    serial: str
    name: str
    scale: float
    differences: int


@final
@dataclass(eq=False)
class ChartedRobot:
    """A robot's runs since its reference. values, sigmas (R, P), in the files' units; several may be left away between
    the baseline and the last runs. total: how many runs there are with those.
    """

    serial: str
    rows: list[Any]
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    sigmas: Floats
    total: int
    scale: Floats = field(default_factory=lambda: np.ones(0))
    charts: DriftCharts | None = None

    @property
    def began(self) -> list[str]:
        """Begin of each run, UTC, ISO 8601."""
        return [row.began for row in self.rows]

    @property
    def runs_a_year(self) -> float:
        """The robot's own rate of runs since its reference."""
        span = (instant(self.rows[-1].began) - instant(self.rows[0].began)) / timedelta(days=365.25)
        return max(LEAST_RUNS_A_YEAR, (self.total - 1) / max(span, 30.0 / 365.25))

    @property
    def limit(self) -> float:
        """Of |u| of each chart: all charts of the robot have at most one false alarm in `HORIZON` on average."""
        return alarm_limit(len(self.names), self.runs_a_year * (HORIZON / timedelta(days=365.25)))

    def judged(self, scale: Floats) -> DriftCharts:
        """Charts of its runs with their σ times `scale` (P,)."""
        self.scale, self.charts = scale, drift_charts(self.values, self.sigmas * scale)
        return self.charts

    def outside(self) -> Iterator[tuple[int, int, int]]:
        """Place of each parameter that is outside now, row of its last value, and the first row since which."""
        assert self.charts is not None
        ratios = np.abs(self.charts.ratio)
        for place in range(len(self.names)):
            known = np.flatnonzero(np.isfinite(ratios[:, place]))
            beyond = ratios[known, place] > self.limit
            if beyond.any() and beyond[-1]:
                inside = np.flatnonzero(~beyond)
                first = known[inside[-1] + 1 if len(inside) else 0]
                yield place, int(known[-1]), int(first)


def charted_robots(index: RunIndex, runs: Path, serial: str = "") -> tuple[dict[str, ChartedRobot], int]:
    """Each robot with its runs since its reference (of one: all; else those that its chart needs), and the number of
    runs that are left out: of another nominal robot than the reference, or with the parameters of an earlier run.
    """
    in_force = _runs_in_force(runs)
    chosen: dict[str, list[Any]] = {}
    totals: dict[str, int] = {}
    left_out = 0
    for own, found in groupby(index.model_runs(serial), key=lambda row: row.serial):
        rows = list({row.identity or (row.place, row.run): row for row in found}.values())
        first = _reference(rows, in_force.get(own))
        comparable = [row for row in rows[first:] if row.nominal == rows[first].nominal]
        left_out += len(rows[first:]) - len(comparable)
        totals[own] = len(comparable)
        begin = BASELINE + 1
        chosen[own] = comparable if serial else [*comparable[:begin], *comparable[begin:][-_LAST:]]
    by_run = _parameters(index, [row for rows in chosen.values() for row in rows])
    robots = {}
    for own, rows in chosen.items():
        robot, repeated = _filled(own, rows, by_run, totals[own])
        left_out += repeated
        if robot:
            robots[own] = robot
    return robots, left_out


def _reference(rows: Sequence[Any], in_force: str | None) -> int:
    """Place of the run to which later ones are compared: that of the table in force by the history of tables, else the
    last one that proved its table, else the first.
    """
    names = [row.run for row in rows]
    if in_force in names:
        return names.index(in_force)
    proved = [place for place, row in enumerate(rows) if row.table_state == "proved"]
    return proved[-1] if proved else 0


def _runs_in_force(runs: Path) -> dict[str, str]:
    """Serial → the run whose model the table in force is of, of the controllers with a history."""
    found: dict[str, str] = {}
    for history in histories(runs):
        entries, _ = history.read()
        if entries and entries[-1].state == "in force":
            begin = entries[-1].begin
            run = (begin.facts and begin.facts.run) or begin.run
            if run:
                found[history.serial] = run
    return found


def _parameters(index: RunIndex, rows: Iterable[Any]) -> dict[tuple[str, str], dict[str, tuple[str, float, float]]]:
    """Place and run → name → unit, value and σ of its determined parameters but those of base and tool, which change
    with the set-up.
    """
    by_place: dict[str, list[str]] = defaultdict(list)
    for row in rows:
        by_place[row.place].append(row.run)
    found: dict[tuple[str, str], dict[str, tuple[str, float, float]]] = defaultdict(dict)
    frames = tuple(f"{frame}_{axis}" for frame in FRAMES for axis in "xyzabc")
    for place, names in by_place.items():
        for run, name, unit, value, sigma in index.parameters_of(place, names, DETERMINED):
            if name.partition("@")[0] not in frames:
                found[place, run][name] = unit, value, sigma
    return found


def _filled(
    serial: str, rows: Sequence[Any], by_run: Mapping[tuple[str, str], dict[str, tuple[str, float, float]]], total: int
) -> tuple[ChartedRobot | None, int]:
    """A robot with its parameters, None if its reference has none; and how many runs repeat an earlier one's."""
    reference = by_run.get((rows[0].place, rows[0].run))
    if not reference:
        return None, 0
    names = tuple(reference)
    kept, values, sigmas, seen = [], [], [], set()
    for row in rows:
        own = by_run.get((row.place, row.run), {})
        each = [own.get(name, ("", np.nan, np.nan)) for name in names]
        value = tuple(one[1] for one in each if one[1] == one[1])
        if value and value not in seen:  # a run may have taken over the model of an earlier one
            seen.add(value)
            kept.append(row)
            values.append([one[1] for one in each])
            sigmas.append([one[2] for one in each])
    units = tuple(unit for unit, _, _ in reference.values())
    repeated = len(rows) - len(kept)
    return ChartedRobot(serial, kept, names, units, np.array(values), np.array(sigmas), total - repeated), repeated


def judge_all(robots: Collection[ChartedRobot], types: Mapping[str, str]) -> list[SmallSigma]:
    """Chart all robots with the σ that their runs show; returns where the stated one is too small.

    σ is never made smaller. The scatter is that of all robots of the type, or that of the robot alone if it has enough
    runs and scatters more.
    """
    squares = {robot.serial: squared_differences(robot.values, robot.sigmas) for robot in robots}
    pooled: dict[tuple[str, str], list[Floats]] = defaultdict(list)
    for robot in robots:
        for place, name in enumerate(robot.names):
            pooled[types.get(robot.serial, ""), name].append(squares[robot.serial][:, place])
    small, of_type = [], {}
    for (kind, name), parts in pooled.items():
        count, scale, sure = _scale(np.concatenate(parts))
        of_type[kind, name] = scale
        small += [SmallSigma(kind, "", name, round(scale, 2), count)] if sure else []
    for robot in robots:
        kind, scales = types.get(robot.serial, ""), []
        for place, name in enumerate(robot.names):
            count, scale, _ = _scale(squares[robot.serial][:, place])
            usual = of_type[kind, name]
            if scale / usual > 1.0 + _SURE * float(scale_error(max(count, 1))):
                small.append(SmallSigma(kind, robot.serial, name, round(scale, 2), count))
            scales.append(max(scale, usual))
        robot.scale = np.array(scales)
    _chart_all(robots)
    return small


def _chart_all(robots: Collection[ChartedRobot]) -> None:
    """Chart all robots at once, side by side, with missing runs at the end of those that have fewer."""
    longest = max((len(robot.rows) for robot in robots), default=0)
    pairs = [(robot, ((0, longest - len(robot.rows)), (0, 0))) for robot in robots]
    if pairs:
        values = np.hstack([np.pad(robot.values, room, constant_values=np.nan) for robot, room in pairs])
        sigmas = np.hstack([np.pad(robot.sigmas * robot.scale, room, constant_values=np.nan) for robot, room in pairs])
        charts, column = drift_charts(values, sigmas), 0
        for robot in robots:
            own = slice(column, column + len(robot.names))
            rows = slice(len(robot.rows))
            robot.charts = DriftCharts(charts.mean[rows, own], charts.sigma[rows, own], charts.reference[own])
            column = own.stop


def _scale(squares: Floats) -> tuple[int, float, bool]:
    """Number of differences, factor of σ (1 at least), and whether it is surely above 1."""
    count = int(np.isfinite(squares).sum())
    if count < _LEAST_DIFFERENCES:
        return count, 1.0, False
    scale = max(1.0, noise_scale(squares))
    return count, scale, scale > 1.0 + _SURE * float(scale_error(count))


@final
class Kinds:
    """What one model of each nominal robot says of its parameters: labels, and the motion of the TCP."""

    def __init__(self, runs: Path) -> None:
        self._runs = runs
        self._known: dict[str, dict[str, tuple[str, float]]] = {}

    def label(self, row: Any, name: str) -> str:
        """As people read it."""
        return self._of(row).get(name, (name, 0.0))[0]

    def mm(self, row: Any, name: str) -> float | None:
        """RMS motion of the TCP over the measured joints for a change of 1 in the file's unit, with base and tool as
        they are; None if no model is here.
        """
        found = self._of(row).get(name)
        return found[1] if found else None

    def _of(self, row: Any) -> dict[str, tuple[str, float]]:
        if row.nominal not in self._known:
            try:
                self._known[row.nominal] = _columns(ModelFile.load(self._runs / row.run / MODEL))
            except (InputError, OSError, ValueError):  # of another host, or gone
                return {}
        return self._known[row.nominal]


def _columns(file: ModelFile) -> dict[str, tuple[str, float]]:
    model, region = file.robot_model(), file.measured_region()
    motion = model.jacobian(spread_over(region.lower, region.upper, _POSTURES, scramble=False))[:, :3]
    rms = np.sqrt(np.mean(np.sum(motion**2, axis=1), axis=0))
    return {each.name: (each.label, float(size)) for each, size in zip(model.parameters, rms, strict=True)}
