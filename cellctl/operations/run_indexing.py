"""Keeps the index of runs up to date with the journals, and answers lists of runs from it."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any, final

from cellctl.clock import calendar_time
from cellctl.files import InputError, canonical_json, parse_yaml
from cellctl.installed import Compared, History, histories
from cellctl.journal import RunState
from cellctl.operations.results import as_json
from cellctl.operations.run_list import (
    ROBOT,
    UNREADABLE,
    RunSummary,
    run_row_and_state,
    run_row_of,
    unborn_row,
    words_of,
)
from cellctl.run_index import (
    FILE_NAME,
    FoundRun,
    HistoryEntry,
    IndexedParameter,
    IndexedRun,
    IndexUnusable,
    RunFilter,
    RunIndex,
    Scanner,
    Series,
    fingerprint,
    opened_index,
    remove_damaged,
    shared_url,
)

MODEL = "model.json"
"""The identified robot, in the folder of a run."""

LEFT_OUT = ""
"""The series of runs that a history cannot compare."""

DAMAGED = "its journal is damaged"

_BATCH = 100
"""Number of runs that are written in one transaction: what a cut costs is read again."""

_THOROUGH = timedelta(minutes=10)
"""After this time, a list compares the file of every journal again: see `Scanner`."""


def read_run(folder: Path) -> IndexedRun:
    """What the index holds of the run in `folder`, by its files; without a state if it is no run."""
    found = fingerprint(str(folder))  # before its files are read: what changes meanwhile is read again
    if not found:
        row = unborn_row(folder) if folder.is_dir() else None
        return _indexed(row, found) if row else IndexedRun(run=folder.name, fingerprint="", state="", content="{}")
    row, state = run_row_and_state(folder)
    return _indexed(row, found, state, folder)


def followed_run(folder: Path, state: RunState) -> IndexedRun:
    """As `read_run`, by the `state` of a journal that is followed; read again when no process writes it."""
    return _indexed(run_row_of(folder, state), "", state, folder)


def _indexed(row: RunSummary, found: str, state: RunState | None = None, folder: Path | None = None) -> IndexedRun:
    ended = state.ended if state else None
    has_model, nominal, parameters = _model(folder) if folder and state else (False, "", ())
    site, due_days = _cell_facts(state.started.cell.text) if state and state.started else ("", None)
    closed = bool(found) and not found.split(" ")[1]  # no write-ahead log beside it
    return IndexedRun(
        run=row.run,
        fingerprint=found,
        settled=bool(ended) and closed and not row.process,
        identity=_identity(state),
        began_as=state.name if state else "",
        began=row.began or "",
        ended=(ended.calendar if ended else "") or "",
        state=row.state,
        verdict=row.verdict or "",
        procedure=row.procedure_name,
        robot_type=str(row.devices.get(ROBOT, {}).get("model", "")),
        serial=row.serial,
        site=site,
        cell=row.cell or "",
        operator=row.operator or "",
        simulated=row.simulated,
        points=row.points,
        before_mm=row.before.mean if row.before else None,
        after_mm=row.after.mean if row.after else None,
        acceptance=row.accepted,
        table_state=row.table_state or "",
        process=row.process or "",
        has_model=has_model,
        nominal=nominal,
        due_days=due_days,
        words=words_of(row),
        content=json.dumps(as_json(row), ensure_ascii=False),
        parameters=parameters,
        entries=tuple(_entries(state)) if state and state.state == "finished" else (),
    )


def _identity(state: RunState | None) -> str:
    started = state.started if state else None
    if started is None:
        return ""
    told = (started.name, started.calendar, started.operator, started.seed, started.procedure.text, started.cell.text)
    return blake2b(repr(told).encode(), digest_size=12).hexdigest()


@lru_cache(64)
def _cell_facts(cell: str) -> tuple[str, float | None]:
    """The site that a cell file states for its reports, empty if it does not; and its `calibration_days`."""
    if "site:" not in cell and "calibration_days:" not in cell:
        return "", None
    try:
        data = parse_yaml(cell, "the cell file").data
        days, report = data.get("calibration_days"), data.get("report")
    except (InputError, AttributeError):
        return "", None
    site = report.get("site", "") if isinstance(report, dict) else ""
    return str(site), float(days) if isinstance(days, int | float) else None


def _model(folder: Path) -> tuple[bool, str, tuple[IndexedParameter, ...]]:
    """Whether the run has a model, a digest of its nominal robot, and the parameters that its rows inform.

    None of a model that cannot be read.
    """
    file = folder / MODEL
    if not file.is_file():
        return False, "", ()
    try:
        stored = json.loads(file.read_text(encoding="utf-8"))
        found = [
            IndexedParameter(each["name"], each["unit"], each["value"], each["sigma"], each["prior_sigma"])
            for each in stored["parameters"]
            if 0.0 < each["sigma"] < each["prior_sigma"]
        ]
        robot = [stored["robot"].get(name) for name in ("convention", "links", "joints")]  # as `incomparable` has it
        nominal = blake2b(canonical_json(robot).encode(), digest_size=8).hexdigest()
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return True, "", ()
    return True, nominal, tuple(found)


def _entries(state: RunState) -> Iterator[HistoryEntry]:
    for history in histories():
        try:
            found = history.entry(state)
        except Exception as error:  # of rows that another version wrote, or of another package's code
            logging.getLogger(__name__).warning("%s is not in the history '%s': %s", state.name, history.name, error)
            found = LEFT_OUT, "", {"why": DAMAGED if isinstance(error, InputError) else str(error)}
        if found:
            series, title, content = found
            yield HistoryEntry(history.name, series, title, json.dumps(content, ensure_ascii=False))


def summary_of(found: FoundRun) -> RunSummary:
    """A run of a list."""
    row = RunSummary.of_json(json.loads(found.content), found.note or None)
    if found.present:
        return row
    content = {name: value for name, value in json.loads(found.content).items() if name not in ("problem", "cure")}
    lost = {"state": "vanished", "process": None, "sentence": f"Its folder is gone: {found.note}."}
    return RunSummary.of_json({**content, **lost}, found.note)


def update(index: RunIndex, runs: Path, *, thorough: bool = False) -> None:
    """Bring the index up to date with the folder `runs`. Raises IndexUnusable."""
    scanner = Scanner(index, runs)
    changes = scanner.look(thorough=thorough or _is_due(index))
    for start in range(0, len(changes.unread), _BATCH):
        index.put([read_run(runs / name) for name in changes.unread[start : start + _BATCH]])
    index.vanish(changes.gone)
    scanner.done(changes)


def _is_due(index: RunIndex) -> bool:
    looked = index.looked()
    return not looked or instant(calendar_time()) - instant(looked) > _THOROUGH


def instant(text: str) -> datetime:
    """An instant, ISO 8601."""
    return datetime.fromisoformat(text)


@contextmanager
def current_index(runs: Path) -> Iterator[RunIndex]:
    """The index of the folder `runs`, up to date. One that cannot be used is made again, or replaced for this time."""
    index = opened_index(runs)
    try:
        try:
            update(index, runs)
        except IndexUnusable as error:
            logging.getLogger(__name__).warning("the index of the runs is made anew: %s", error)
            index.close()
            remove_damaged(runs, thorough=True)
            index = opened_index(runs, temporary=True)
            update(index, runs)
        yield index
    finally:
        index.close()


def run_rows(runs: Path, asked: RunFilter | None = None) -> list[RunSummary]:
    """The runs in the folder `runs`, newest first; those that are as `asked`."""
    with current_index(runs) as index:
        return [summary_of(found) for found in index.page(asked)]


def runs_to_compare(runs: Path, history: str) -> list[str]:
    """Names of the runs in the folder `runs` that may be in a history, by its name: unreadable ones are among them."""
    with current_index(runs) as index:
        unreadable = index.lines(RunFilter(state=UNREADABLE), "run")
        return sorted({*index.runs_in(history), *(name for (name,) in unreadable)})


def tell_existing_index(folder: Path) -> None:
    """As `tell_index`, if there is an index of the runs' folder: of a run whose report was written again."""
    if shared_url() or (folder.parent / FILE_NAME).is_file():
        tell_index(folder)


@final
@dataclass(frozen=True)
class ComparedSeries:
    """Series of a history, each compared; total: how many there are. left_out: name of a run, and why."""

    histories: tuple[Compared, ...]
    total: int
    left_out: tuple[tuple[str, str], ...]

    def to_json(self) -> dict[str, Any]:
        """For JSON."""
        left_out = [{"run": name, "why": why} for name, why in self.left_out]
        return {"histories": [each.to_json() for each in self.histories], "left_out": left_out, "total": self.total}


def series_of(index: RunIndex, history: History) -> list[Series]:
    """The series of a history, the one with the latest run first."""
    return [each for each in index.series(history.name) if each.series != LEFT_OUT]


def compared_series(index: RunIndex, history: History, series: str, first_runs: int | None = None) -> Compared:
    """A series of a history. Raises ValueError if its runs cannot be compared."""
    entries = [(run, json.loads(content)) for run, content in index.entries(history.name, series)]
    return history.compare(entries, first_runs)


def left_out_of(index: RunIndex, history: History) -> list[tuple[str, str]]:
    """Name and reason of the runs that a history cannot compare; those that cannot be read may be of another kind."""
    own = [(run, json.loads(content)["why"]) for run, content in index.entries(history.name, LEFT_OUT)]
    return sorted(own + [(run, DAMAGED) for (run,) in index.lines(RunFilter(state=UNREADABLE), "run")])


def history_page(
    index: RunIndex, history: History, first_runs: int | None = None, *, offset: int = 0, limit: int | None = None
) -> ComparedSeries:
    """Some of the series of a history, from number `offset` on, the one with the latest run first."""
    listed = series_of(index, history)
    found, left_out = [], left_out_of(index, history)
    for each in listed[offset : None if limit is None else offset + limit]:
        try:
            found.append(compared_series(index, history, each.series, first_runs))
        except ValueError as error:
            runs = index.entries(history.name, each.series)
            left_out += [(run, f"its points cannot be compared: {error}") for run, _ in runs]
    return ComparedSeries(tuple(found), len(listed), tuple(left_out))


def tell_index(folder: Path, *, resumed: bool = False) -> None:
    """Tell the index of the runs' folder what is in the run folder `folder` now. A failure is a warning.

    resumed: the run is about to change again.
    """
    try:
        with opened_index(folder.parent, strict=True) as index:
            found = read_run(folder)
            index.put([replace(found, settled=False) if resumed else found])
    except Exception as error:  # a run never fails for its index
        logging.getLogger(__name__).warning("run %s is not in the index of the runs yet: %s", folder.name, error)


@final
@dataclass(frozen=True, slots=True)
class IndexCheck:
    """How an index agrees with the journals. Names of runs: missing in it, outdated or different, vanished folders."""

    index: str
    runs: int
    missing: tuple[str, ...]
    different: tuple[str, ...]
    vanished: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether it says what the journals say."""
        return not (self.missing or self.different)


def rebuild_index(runs: Path) -> IndexCheck:
    """Make the index of the folder `runs` anew from all journals. Raises IndexUnusable."""
    remove_damaged(runs, thorough=True)
    with opened_index(runs, strict=True) as index:
        index.clear()
        update(index, runs, thorough=True)
        return IndexCheck(index.shown, index.count(), (), (), ())


def verify_index(runs: Path) -> IndexCheck:
    """Compare the index with all journals, which are read for that; changes nothing. Raises IndexUnusable."""
    with opened_index(runs, strict=True) as index:
        known = index.known()
        folders = sorted(each for each in runs.iterdir() if each.is_dir()) if runs.is_dir() else []
        missing, different = [], []
        for folder in folders:
            found = read_run(folder)
            if not known.get(folder.name, ("", False))[1]:
                missing += [folder.name] if found.state else []
            elif index.differs(found):
                different.append(folder.name)
        here = {folder.name for folder in folders}
        vanished = sorted(run for run in known if run not in here)
        return IndexCheck(index.shown, index.count(), tuple(missing), tuple(different), tuple(vanished))


def names_text(names: Iterable[str], most: int = 10) -> str:
    """The first names, and how many more there are."""
    listed = list(names)
    more = f" and {len(listed) - most} more" if len(listed) > most else ""
    return ", ".join(listed[:most]) + more
