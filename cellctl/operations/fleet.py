"""Drift of a fleet: which robots need a calibration, and why, by the parameters of all runs in the index.

`cellctl.metrology.drift_charts` has the statistics, `fleet_charts` what is charted; here is what follows.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final, Literal, final

import numpy as np

from cellctl.calibration.model.parameter import MM, RAD
from cellctl.clock import calendar_time
from cellctl.kinematics import Bools, Floats
from cellctl.metrology.daily_check import DailyAction
from cellctl.metrology.drift_charts import (
    DriftCharts,
    alarm_limit,
    common_change,
    found_shift,
    recent_change,
)
from cellctl.operations.fleet_charts import ChartedRobot, Kinds, SmallSigma, charted_robots, judge_all
from cellctl.operations.run_indexing import instant
from cellctl.run_index import RunIndex

DUE_DAYS: Final = 180.0
"""The calibration of a real robot whose cell file does not state `calibration_days` is due after so many days."""

_LEAST_ROBOTS: Final = 3
"""Number of robots from which on a type or site has charts of its own."""

_MONTHS: Final = 60.0
"""A type or site is judged once a month: so often in five years."""

_UNITS = {unit.name: unit for unit in (MM, RAD)}

State = Literal["calibrate", "in limits", "not judged", "not calibrated"]

Why = Literal["check", "drift", "age"]


@final
@dataclass(frozen=True, slots=True)
class Moved:
    """A parameter whose chart is outside its limits, in `unit` as shown to people.

    change, sigma: from the reference by the last runs (of several robots: what most have in common), and 1 σ of that.
    ratio: of the chart, in σ; limit: of its magnitude. since: begin of the first run since which it is outside, the
    first of the last 30 at the earliest. mm: RMS motion of the TCP over the measured
    joints that the change makes; None where no model of the type is in this folder.
    """

    name: str
    label: str
    unit: str
    change: float
    sigma: float
    ratio: float
    limit: float
    since: str
    mm: float | None = None

    @property
    def words(self) -> str:
        """In a phrase."""
        tool = "" if self.mm is None else f", {self.mm:.2f} mm at the tool"
        digits = max(0, 1 - int(np.floor(np.log10(self.sigma))))  # two digits of σ
        change = f"{self.change:+.{digits}f} ± {self.sigma:.{digits}f}".replace("-", "−")
        return f"{self.label} {change} {self.unit} since {self.since[:10]}{tool}"


@final
@dataclass(frozen=True, slots=True)
class Reason:
    """Why a robot needs a calibration: `check` (a failed one), `drift` or `age`; text: in a phrase."""

    why: Why
    text: str


@final
@dataclass(frozen=True, slots=True)
class FleetRobot:
    """A robot, by its serial. type, site: of its last run. runs: that have a model and are compared.

    calibration: the run that is the reference; calibrated: its begin, empty without one. age_days: of that; due_days:
    None: never due. runs_a_year: since then. limit: of |change| / σ of its charts. moved: largest motion of the tool
    first. together: names of the parameters that moved in most robots of its type or site too.
    """

    serial: str
    type: str
    site: str
    simulated: bool
    state: State
    reasons: tuple[Reason, ...]
    moved: tuple[Moved, ...]
    together: tuple[str, ...]
    runs: int
    charts: int
    calibration: str
    calibrated: str
    age_days: float | None
    due_days: float | None
    runs_a_year: float
    limit: float | None

    @property
    def words(self) -> str:
        """Its reasons in a line."""
        common = f" ({', '.join(self.together)}: as other robots, look at instrument and temperature first)"
        return "; ".join(each.text for each in self.reasons) + common * bool(self.together)


@final
@dataclass(frozen=True, slots=True)
class FleetGroup:
    """The robots of a type or a site. moved: parameters that moved in them together."""

    kind: Literal["type", "site"]
    name: str
    robots: int
    to_calibrate: int
    moved: tuple[Moved, ...]


@final
@dataclass(frozen=True, slots=True)
class Fleet:
    """The robots, most urgent first; groups: types, then sites; left_out: number of runs that are not compared."""

    robots: tuple[FleetRobot, ...]
    groups: tuple[FleetGroup, ...]
    small_sigmas: tuple[SmallSigma, ...]
    left_out: int

    @property
    def to_calibrate(self) -> list[FleetRobot]:
        """Those that need a calibration."""
        return [robot for robot in self.robots if robot.state == "calibrate"]


@final
@dataclass(frozen=True, slots=True)
class ParameterChart:
    """The chart of a parameter over the runs of its robot, in `unit` as shown to people; None where not judged.

    values, sigmas: of each run, less the reference; means: EWMA less reference; limits: ± at each run. scale: σ was
    widened by it. found: the step that is found within ten more runs like the last one with 90 %.
    """

    name: str
    label: str
    unit: str
    values: tuple[float | None, ...]
    sigmas: tuple[float | None, ...]
    means: tuple[float | None, ...]
    limits: tuple[float | None, ...]
    scale: float
    found: float | None


@final
@dataclass(frozen=True, slots=True)
class RobotCharts:
    """The charts of a robot, that furthest from its middle first; runs, began (R,): oldest first."""

    serial: str
    runs: tuple[str, ...]
    began: tuple[str, ...]
    parameters: tuple[ParameterChart, ...]


@final
class FleetReading:
    """All robots of the index of the folder `runs`, read and charted once. Raises IndexUnusable."""

    def __init__(self, index: RunIndex, runs: Path) -> None:
        self._index, self._runs, self._kinds = index, runs, Kinds(runs)
        self._rows = {row.serial: row for row in sorted(index.robots(), key=lambda row: row.last)}  # the last of each
        self._charted, self._left_out = charted_robots(index, runs)
        types = {serial: row.robot_type for serial, row in self._rows.items()}
        self._small = judge_all(self._charted.values(), types)

    def fleet(self, robot_type: str = "", site: str = "", now: str = "") -> Fleet:
        """The robots of a type, of a site; empty: of all. now: instant, ISO 8601; empty: now."""
        groups = [*self._groups("type"), *self._groups("site")]
        checks, at = _failed_checks(self._index), instant(now or calendar_time())
        found = [
            _robot(row, self._charted.get(serial), checks.get(serial, ()), groups, self._kinds, at)
            for serial, row in self._rows.items()
        ]
        chosen = [each for each in found if robot_type in ("", each.type) and site in ("", each.site)]
        return Fleet(
            tuple(sorted(chosen, key=_urgency)),
            tuple(_counted(group, found) for group in groups if _is_of(group, chosen)),
            tuple(each for each in self._small if robot_type in ("", each.type)),
            self._left_out,
        )

    def charts(self, serial: str) -> RobotCharts:
        """The charts of a robot over all its runs since its reference. Raises LookupError if it has none."""
        if serial not in self._charted:
            raise LookupError(serial)
        known = dict(zip(self._charted[serial].names, self._charted[serial].scale, strict=True))
        robot = charted_robots(self._index, self._runs, serial)[0][serial]
        charts = robot.judged(np.array([known.get(name, 1.0) for name in robot.names]))
        order = np.argsort(-np.nan_to_num(_last(np.abs(charts.ratio))))
        parameters = tuple(_parameter_chart(robot, charts, int(place), self._kinds) for place in order)
        return RobotCharts(serial, tuple(row.run for row in robot.rows), tuple(robot.began), parameters)

    def _groups(self, kind: Literal["type", "site"]) -> Iterator[FleetGroup]:
        """The types or sites, of which the number of robots to calibrate is not counted yet."""
        column = "robot_type" if kind == "type" else "site"
        members: dict[str, list[str]] = defaultdict(list)
        for serial, row in self._rows.items():
            members[getattr(row, column)].append(serial)
        for name, serials in sorted(members.items()):
            robots = [self._charted[serial] for serial in serials if serial in self._charted]
            moved = tuple(_moved_together(robots, self._kinds)) if len(robots) >= _LEAST_ROBOTS else ()
            if name:
                yield FleetGroup(kind, name, len(serials), 0, moved)


def fleet(index: RunIndex, runs: Path, *, robot_type: str = "", site: str = "", now: str = "") -> Fleet:
    """As `FleetReading.fleet`."""
    return FleetReading(index, runs).fleet(robot_type, site, now)


def _parameter_chart(robot: ChartedRobot, charts: DriftCharts, place: int, kinds: Kinds) -> ParameterChart:
    factor, shown = _shown(robot.units[place])
    sigma = charts.sigma[:, place] * factor
    values, spread, last = robot.values[:, place], robot.sigmas[:, place] * robot.scale[place], _last(sigma)
    return ParameterChart(
        robot.names[place],
        kinds.label(robot.rows[0], robot.names[place]),
        shown,
        _numbers((values - charts.reference[place]) * factor),
        _numbers(spread * factor),
        _numbers(charts.mean[:, place] * factor),
        _numbers(robot.limit * sigma),
        round(float(robot.scale[place]), 3),
        float(found_shift(robot.limit, last, 10)) if np.isfinite(last) else None,
    )


def _numbers(values: Floats) -> tuple[float | None, ...]:
    return tuple(float(value) if np.isfinite(value) else None for value in values)


def _last(values: Floats) -> Any:
    """The last value of each column that is known, NaN without one."""
    known = np.isfinite(values)
    rows = len(values) - 1 - np.argmax(known[::-1], axis=0)
    return np.take_along_axis(np.asarray(values), np.expand_dims(rows, 0), axis=0)[0]


def _shown(unit: str) -> tuple[float, str]:
    known = _UNITS.get(unit)
    return (known.factor, known.shown) if known else (1.0, unit)


def _moved(robot: ChartedRobot, kinds: Kinds) -> tuple[Moved, ...]:
    assert robot.charts is not None
    found = []
    for place, last, since in robot.outside():
        ratio, spread = float(robot.charts.ratio[last, place]), robot.sigmas[:, place] * robot.scale[place]
        change = recent_change(robot.values[:, place], spread, since)
        found.append(_one(robot, place, change, ratio, robot.limit, robot.rows[since].began, kinds))
    return tuple(sorted(found, key=lambda each: (-(each.mm or 0.0), -abs(each.ratio))))


def _one(
    robot: ChartedRobot,
    place: int,
    change: tuple[float, float],
    ratio: float,
    limit: float,
    since: str,
    kinds: Kinds,
) -> Moved:
    factor, shown = _shown(robot.units[place])
    name, row = robot.names[place], robot.rows[0]
    mm = kinds.mm(row, name)
    return Moved(
        name,
        kinds.label(row, name),
        shown,
        change[0] * factor,
        change[1] * factor,
        round(ratio, 2),
        round(limit, 2),
        since,
        None if mm is None else round(abs(change[0]) * mm, 4),
    )


def _moved_together(robots: Sequence[ChartedRobot], kinds: Kinds) -> Iterator[Moved]:
    """Parameters whose median over the robots is outside its limits in the last month.

    Once a month each robot counts with its last chart of that month.
    """
    names = list(
        dict.fromkeys((name, unit) for robot in robots for name, unit in zip(robot.names, robot.units, strict=True))
    )
    months = sorted({began[:7] for robot in robots for began in robot.began})
    means, sigmas = np.full((2, len(robots), len(months), len(names)), np.nan)
    for number, robot in enumerate(robots):
        assert robot.charts is not None
        columns = [names.index(pair) for pair in zip(robot.names, robot.units, strict=True)]
        for row, began in enumerate(robot.began):
            if np.isfinite(robot.charts.sigma[row]).any():
                at = (number, months.index(began[:7]), columns)
                means[at], sigmas[at] = robot.charts.mean[row], robot.charts.sigma[row]
    counts = np.isfinite(means).sum(axis=0)
    mean, sigma = common_change(means, sigmas)
    limit = alarm_limit(len(names), _MONTHS)
    beyond: Bools = (counts >= _LEAST_ROBOTS) & (np.abs(np.nan_to_num(mean / sigma)) > limit)
    for place, (name, _) in enumerate(names):
        known = np.flatnonzero(counts[:, place] >= _LEAST_ROBOTS)
        if len(known) and beyond[known[-1], place]:
            inside = np.flatnonzero(~beyond[known, place])
            since = months[known[inside[-1] + 1 if len(inside) else 0]]
            robot = next(each for each in robots if name in each.names)
            change = float(mean[known[-1], place]), float(sigma[known[-1], place])
            yield _one(robot, robot.names.index(name), change, change[0] / change[1], limit, since, kinds)


def _counted(group: FleetGroup, robots: Iterable[FleetRobot]) -> FleetGroup:
    own = [robot for robot in robots if _is_of(group, [robot])]
    number = sum(robot.state == "calibrate" for robot in own)
    return FleetGroup(group.kind, group.name, group.robots, number, group.moved)


def _is_of(group: FleetGroup, robots: Iterable[FleetRobot]) -> bool:
    return any(getattr(robot, group.kind) == group.name for robot in robots)


def _failed_checks(index: RunIndex) -> dict[str, list[tuple[str, str]]]:
    """Serial → begin and words of its last checks that failed."""
    found: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for row in index.latest_judged((DailyAction.RECALIBRATE, DailyAction.IN_CONTROL)):
        if row.verdict == DailyAction.RECALIBRATE:
            found[row.serial].append((row.began, f"{row.run} says recalibrate"))
        elif row.acceptance == "rejected":
            found[row.serial].append((row.began, f"{row.run} is rejected"))
    return found


def _robot(
    row: Any,
    charted: ChartedRobot | None,
    failed: Sequence[tuple[str, str]],
    groups: Iterable[FleetGroup],
    kinds: Kinds,
    now: datetime,
) -> FleetRobot:
    began = charted.rows[0].began if charted else ""
    age = (now - instant(began)) / timedelta(days=1) if began else None
    stated = charted.rows[-1].due_days if charted else None
    due = stated or (None if row.simulated else DUE_DAYS)
    moved = _moved(charted, kinds) if charted else ()
    reasons = [Reason("check", text) for begin, text in failed if begin >= began]
    reasons += [Reason("drift", each.words) for each in moved]
    if age is not None and due is not None and age > due:
        reasons.append(Reason("age", f"calibrated {age:.0f} days ago, due after {due:g}"))
    common = {each.name: each for group in groups for each in group.moved if _has(group, row)}
    return FleetRobot(
        serial=row.serial,
        type=row.robot_type,
        site=row.site,
        simulated=bool(row.simulated),
        state=_state(charted, reasons),
        reasons=tuple(reasons),
        moved=moved,
        together=tuple(each.label for each in moved if each.name in common),
        runs=charted.total if charted else 0,
        charts=len(charted.names) if charted else 0,
        calibration=charted.rows[0].run if charted else "",
        calibrated=began,
        age_days=None if age is None else round(age, 2),
        due_days=due,
        runs_a_year=round(charted.runs_a_year, 1) if charted else 0.0,
        limit=round(charted.limit, 3) if charted else None,
    )


def _has(group: FleetGroup, row: Any) -> bool:
    return bool((row.robot_type if group.kind == "type" else row.site) == group.name)


def _state(charted: ChartedRobot | None, reasons: Collection[Reason]) -> State:
    if reasons:
        return "calibrate"
    if charted is None:
        return "not calibrated"
    return "in limits" if len(charted.rows) > 1 else "not judged"


_ORDER: dict[State, int] = {"calibrate": 0, "not calibrated": 1, "not judged": 2, "in limits": 3}


def _urgency(robot: FleetRobot) -> tuple[Any, ...]:
    """Failed checks first, then the largest motion of the tool, then what is due longest."""
    failed = any(each.why == "check" for each in robot.reasons)
    motion = max((each.mm or 0.0 for each in robot.moved), default=0.0)
    strength = max((abs(each.ratio) for each in robot.moved), default=0.0)
    return _ORDER[robot.state], not failed, -motion, -strength, -(robot.age_days or 0.0), robot.serial
