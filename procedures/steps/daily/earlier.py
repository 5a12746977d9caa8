"""Earlier runs of the same check, from the journals beside this run's folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from cellctl.files import InputError
from cellctl.journal import JournalError, RunStarted, RunState, fold, read_journal
from cellctl.procedure import StepContext
from procedures.steps.daily.rows import DailyPointsRow, DailyVerdict, EarlierRun, EarlierRunsRow

_SECTION = DailyVerdict.SECTION[0]
"""A field that only results of this kind of campaign have."""


def read_earlier_runs(context: StepContext) -> EarlierRunsRow:
    """The finished runs with the same baseline in the folder of this run, oldest first. Changes nothing there."""
    day = context.recorded(DailyPointsRow)[-1].day
    earlier, left_out = [], []
    for found in _finished_checks(context.run_folder):
        if isinstance(found, tuple):
            left_out.append(found)
        elif found.day.baseline == day.baseline:
            why = day.same_check(found.day)
            if why:
                left_out.append((found.run, why))
            else:
                earlier.append(found)
    earlier.sort(key=lambda each: (each.began, len(each.run), each.run))
    return EarlierRunsRow(runs=tuple(earlier), left_out=tuple(sorted(left_out)))


def _finished_checks(own: Path) -> Iterator[EarlierRun | tuple[str, str]]:
    """Each finished check beside the folder `own`; of one that cannot be read its name, and why."""
    for journal in sorted(own.parent.glob("*/journal.sqlite")):
        if journal.parent.resolve() == own.resolve():
            continue
        try:
            found = _check_in(journal)
        except (InputError, JournalError):
            found = (journal.parent.name, "its journal is damaged")
        if found:
            yield found


def _check_in(journal: Path) -> EarlierRun | tuple[str, str] | None:
    """The check that the journal holds; None if it is another campaign's, or one that did not finish."""
    first = next(read_journal(journal), None)
    if first is None or not isinstance(first.event, RunStarted) or _SECTION not in (first.event.section or ()):
        return None
    state: RunState = fold(read_journal(journal))
    row = state.last(DailyPointsRow)
    if state.state != "finished" or row is None:
        return None
    return EarlierRun(run=first.event.name or journal.parent.name, began=first.event.calendar, day=row.day)
