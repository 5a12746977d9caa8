"""What a run came to: its folder, its result as JSON, its last words and its exit code."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from cellctl.cli.ends import Exit
from cellctl.cli.outputs import to_stdout
from cellctl.clock import calendar_time
from cellctl.engine import Outcome, State
from cellctl.files import InputError, Problem, write_atomically
from cellctl.journal import JournalError, PushedTable, RunResult, RunState, fold, read_journal

SIMULATOR_MEMORY = "simulated_cell.json"
"""Where in the run folder a simulated cell remembers where its robot stands, so that a resumed run finds it there."""

_BY_STATE = {
    State.ABORTED: Exit.ABORTED,
    State.FAILED: Exit.DEVICE_FAILED,
    State.UNCERTAIN: Exit.UNCERTAIN,
}


def new_run_folder(runs: Path, procedure: str) -> Path:
    """Make a folder for a new run, `sphere_selfcal-20261121T192433Z`, numbered where that is taken.

    Raises InputError where it cannot be made.
    """
    stem = f"{procedure}-{calendar_time().replace('-', '').replace(':', '')}"
    try:
        runs.mkdir(parents=True, exist_ok=True)
        for number in range(1, 1000):
            folder = runs / (stem if number == 1 else f"{stem}-{number}")
            try:
                folder.mkdir()
            except FileExistsError:
                continue
            return folder
    except OSError as error:
        cure = "give another folder with --runs"
        raise InputError(Problem(str(runs), 0, 0, f"cannot hold a run: {error.strerror}", cure)) from error
    raise InputError(Problem(str(runs), 0, 0, f"holds 999 runs '{stem}' already", "give another folder with --runs"))


def result_of(folder: Path, outcome: Outcome, wall_s: float) -> RunResult:
    """The result of a run that this process ran."""
    error = str(outcome.error) if outcome.error else None
    known = {"state": outcome.state.value, "error": error, "simulated_s": outcome.seconds, "wall_s": wall_s}
    return RunResult.of(folder.name, fold(read_journal(folder)), **known)


def write_json(result: dict[str, Any], target: str | None) -> None:
    """Write `result` to a file, or to stdout for `-`."""
    if target is None:
        return
    text = json.dumps(result, indent=2, ensure_ascii=False) + "\n"
    if target == "-":
        to_stdout(text)
    else:
        write_atomically(Path(target), text)


def keep_json(result: RunResult, target: str | None, folder: Path) -> None:
    """`write_json` of a run's result. One that fails spoils no run: it is said on stderr, and can be had again."""
    try:
        write_json(result.to_json(), target)
    except OSError as error:
        again = f"have it again with: cellctl show {folder} --json FILE"
        print(f"cellctl: no JSON: {target}: {error.strerror or error}\n    {again}", file=sys.stderr)


def report_of(folder: Path) -> None:
    """Write the run's report. A report that fails spoils no run: it is said on stderr, and can be rebuilt."""
    from cellctl.report import write_report

    try:
        write_report(folder)
    except (OSError, ValueError, LookupError, InputError, JournalError) as error:
        print(f"cellctl: no report: {error}\n    rebuild it with: cellctl report {folder}", file=sys.stderr)


def exit_of(outcome: Outcome) -> Exit:
    """The exit code of a run's end."""
    if outcome.state is not State.FINISHED:
        return Exit.BAD_INPUT if isinstance(outcome.error, InputError) else _BY_STATE[outcome.state]
    better = outcome.verdict is None or outcome.verdict.better
    return Exit.GOOD if better else Exit.NOT_BETTER


def table_line(state: RunState, folder: Path, *, only_unproved: bool = False) -> str:
    """What became of the table that the run pushed, and what to do where it may be in force unproved; may be empty."""
    table = PushedTable.of(state)
    if table is None or (only_unproved and not table.unproved_in_force):
        return ""
    if not table.unproved_in_force:
        return table.words()
    memory = folder / SIMULATOR_MEMORY
    cell = f"--cell {state.started.cell.path if state.started else 'CELL'}"
    cell += f" --state {memory}" if memory.exists() else ""
    look = f"look with `cellctl table show {cell}`; take it back with `cellctl table rollback {cell}`"
    return f"{table.words()}: {look}"


def say_end(outcome: Outcome, result: RunResult, folder: Path, *, quiet: bool) -> None:
    """The verdict in one sentence, or what went wrong and where things stand (on stderr)."""
    state = fold(read_journal(folder))
    if outcome.state is State.FINISHED:
        if not quiet:
            print("\n".join([result.sentence or "Finished.", *result.lines]))
            print(f"Run folder: {folder}")
        if said := table_line(state, folder, only_unproved=True):
            print(f"cellctl: {said}", file=sys.stderr)
        return
    lines = [f"cellctl: run {outcome.state.value}: {outcome.error or 'the clean-up did not succeed'}"]
    lines += [f"    {trouble}" for trouble in outcome.troubles]
    lines.append(f"    {_where_the_robot_is(outcome)}")
    if said := table_line(state, folder):
        lines.append(f"    {said}")
    lines.append(f"    {result.points} measurements are recorded in {folder}")
    print("\n".join(lines), file=sys.stderr)


def _where_the_robot_is(outcome: Outcome) -> str:
    """What is known of the robot at the end of a run; that it is held only where this run had that confirmed."""
    if outcome.held:
        held = "the robot is held: its controller confirmed that it stands still"
        return held if outcome.moved else f"nothing was moved, and {held}"
    if not outcome.moved:
        return "nothing was moved"
    return "nobody confirmed that the robot stands still: look at it before anything else moves"
