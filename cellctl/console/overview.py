"""All cells that a console knows: what each does, its last verdict, the age of its calibration."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import final

from cellctl.console.alarms import Alarm, Cause
from cellctl.console.live import Snapshot
from cellctl.console.live.changes import waits_for
from cellctl.console.run_queue import utc_now
from cellctl.operations.checking import FileChoice, choices
from cellctl.operations.fleet import DUE_DAYS, FleetRobot
from cellctl.operations.run_indexing import summary_of
from cellctl.operations.run_list import RunSummary
from cellctl.records import PASSED
from cellctl.run_index import RunIndex


@final
@dataclass(frozen=True, slots=True)
class KnownCell:
    """A cell that is offered to start on, or else that runs were on. simulated: None if its file is not readable.

    last: the run on it that began last; calibrated: the last one that identified its robot with success. due_days: its
    calibration is due after so many; None: never.
    """

    name: str
    title: str
    file: Path
    simulated: bool | None
    offered: bool = True
    last: RunSummary | None = None
    calibrated: RunSummary | None = None
    due_days: float | None = None

    def age_days(self, now: datetime) -> float | None:
        """Age of the calibration, days; None without one."""
        return _age_days(self.calibrated.began or "", now) if self.calibrated else None

    def is_due(self, now: datetime) -> bool:
        """Whether its calibration is due."""
        age = self.age_days(now)
        return age is not None and self.due_days is not None and age > self.due_days


@final
@dataclass(frozen=True, slots=True)
class CellOverview:
    """A line of the overview.

    offered: runs can be started on it here. simulated: null if the cell file is not readable. host: of the last run on
    it; empty: not known. run: in progress, with its state, steps done and in total, time left (s), and what it waits
    for. last_run … last_verdict: of the run that began last. calibrated_by: the run; age_days: of that; due: it is too
    old.
    """

    name: str
    title: str
    offered: bool
    simulated: bool | None
    host: str = ""
    run: str = ""
    state: str = ""
    phase: str = ""
    done: int = 0
    total: int = 0
    left_s: float | None = None
    waits_for: str = ""
    last_run: str = ""
    last_began: str = ""
    last_state: str = ""
    last_verdict: str = ""
    calibrated_by: str = ""
    age_days: float | None = None
    due: bool = False
    alarms: int = 0


def rows_of_cells(index: RunIndex) -> list[RunSummary]:
    """Of each cell the latest run and the latest one that calibrated it, newest first. For a thread."""
    rows = {found.run: found for found in (*index.latest_of_cells(), *index.latest_of_cells(PASSED))}
    return sorted(map(summary_of, rows.values()), key=lambda row: row.began or "", reverse=True)


def last_run_of(index: RunIndex, cell: Path) -> str:
    """The name of the run that began last on the cell of this file; empty without one. For a thread."""
    runs = (
        found.run for found in index.latest_of_cells() if cell_place(summary_of(found).cell or "") == cell_place(cell)
    )
    return next(runs, "")


def known_cells(named: Path | None, rows: Iterable[RunSummary]) -> list[KnownCell]:
    """The cells to choose (`named`: the console's own), and those of runs. rows: the newest first."""
    last: dict[str, RunSummary] = {}
    calibrated: dict[str, RunSummary] = {}
    for row in rows:
        if file := row.cell:
            file = cell_place(file)
            last.setdefault(file, row)
            if row.after and row.verdict in PASSED and row.state == "finished":
                calibrated.setdefault(file, row)
    known = {cell_place(one.file): one for one in choices("cell", named).values()}
    of_runs = {file: _of_run(file, row) for file, row in last.items() if file not in known}
    found = {**known, **of_runs}
    return [_known(one, file in known, last.get(file), calibrated.get(file)) for file, one in found.items()]


def calibration_causes(cells: Iterable[KnownCell]) -> Iterator[tuple[Cause, bool]]:
    """For each cell with a calibration the cause of an alarm, and whether it is due."""
    now = utc_now()
    for cell in cells:
        if cell.calibrated and cell.due_days is not None:
            age = cell.age_days(now) or 0.0
            what = f"calibration of {cell.name} is {age:.0f} days old, and due after {cell.due_days:g} days"
            cure = "calibrate the robot, or state `calibration_days` in the cell file"
            yield Cause("calibration", f"calibration:{cell.file}", what, cure, cell.name), cell.is_due(now)


def drift_causes(robots: Iterable[FleetRobot]) -> Iterator[tuple[Cause, bool]]:
    """For each robot of a fleet that is charted the cause of an alarm, and whether a chart is outside its limits."""
    for robot in robots:
        if robot.charts:
            moved = "; ".join(each.words for each in robot.moved)
            cure = "look at /fleet; calibrate the robot"
            yield Cause("chart", f"drift:{robot.serial}", f"{robot.serial} moved: {moved}", cure), bool(moved)


def overview(
    cells: Iterable[KnownCell], active: Collection[Snapshot], alarms: Collection[Alarm], hosts: dict[str, str]
) -> list[CellOverview]:
    """The cells, those with a run in progress first. hosts: run → the computer that runs or ran it."""
    now = utc_now()
    runs = {cell_place(each.state.started.cell.path): each for each in active if each.state.started}
    found = [_line(cell, runs.get(cell_place(cell.file)), alarms, hosts, now) for cell in cells]
    return sorted(found, key=lambda line: (not line.run, not line.last_began, line.simulated is not False, line.name))


def _line(
    cell: KnownCell, run: Snapshot | None, alarms: Collection[Alarm], hosts: dict[str, str], now: datetime
) -> CellOverview:
    last, status = cell.last, run.status if run else None
    age = cell.age_days(now)
    return CellOverview(
        cell.name,
        cell.title,
        cell.offered,
        cell.simulated,
        host=hosts.get(run.run if run else last.run if last else "", ""),
        run=run.run if run else "",
        state=status.state if status else "",
        phase=status.phase if status else "",
        done=status.done if status else 0,
        total=status.total if status else 0,
        left_s=status.left_s if status else None,
        waits_for=waits_for(run),
        last_run=last.run if last else "",
        last_began=(last.began or "") if last else "",
        last_state=last.state if last else "",
        last_verdict=(last.verdict or "") if last else "",
        calibrated_by=cell.calibrated.run if cell.calibrated else "",
        age_days=None if age is None else round(age, 2),
        due=cell.is_due(now),
        alarms=sum(alarm.stands and alarm.cell == cell.name for alarm in alarms),
    )


def cell_place(file: str | Path) -> str:
    """A cell file as runs are compared by: a run may name it by a path from its working folder, which is ours."""
    return str(Path(file).absolute())


def _of_run(file: str, row: RunSummary) -> FileChoice:
    name = Path(file).stem
    return FileChoice(name, Path(file), name, shipped=False, simulated=row.simulated)


def _known(one: FileChoice, offered: bool, last: RunSummary | None, calibrated: RunSummary | None) -> KnownCell:
    usual = DUE_DAYS if one.simulated is False else None
    due_days = one.calibration_days or usual
    return KnownCell(one.name, one.title, one.file, one.simulated, offered, last, calibrated, due_days)


def _age_days(began: str, now: datetime) -> float | None:
    try:
        return (now - datetime.fromisoformat(began)).total_seconds() / 86400.0
    except (ValueError, TypeError):  # made by another program
        return None
