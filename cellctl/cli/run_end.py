"""The end of a run: the last lines on the terminal, its JSON and report, the exit code."""

from __future__ import annotations

import sys
from pathlib import Path

from cellctl.cli.ends import Exit, errors_text
from cellctl.cli.outputs import write_json
from cellctl.engine import AbortedByInterlock, Outcome, State
from cellctl.files import InputError
from cellctl.journal import JournalError, RunEnded, RunResult, fold, read_journal
from cellctl.operations.run_folder import table_line
from cellctl.operations.run_list import RunEnd


def keep_json(result: RunResult, target: str | None, folder: Path) -> None:
    """`write_json` of a run's result. A failure is only printed on stderr: the JSON can be written again."""
    try:
        write_json(result.to_json(), target)
    except OSError as error:
        again = f"have it again with: cellctl show {folder} --json FILE"
        print(f"cellctl: no JSON: {target}: {error.strerror or error}\n    {again}", file=sys.stderr)


def report_of(folder: Path) -> None:
    """Write the run's report. A failure is only printed on stderr: the report can be rebuilt."""
    from cellctl.report import write_report

    try:
        write_report(folder)
    except (OSError, ValueError, LookupError, InputError, JournalError) as error:
        print(f"cellctl: no report: {error}\n    rebuild it with: cellctl report {folder}", file=sys.stderr)


def exit_of(outcome: Outcome) -> Exit:
    """The exit code of a run's end."""
    match outcome.state, outcome.error:
        case State.FINISHED, _:
            passed = outcome.verdict is None or outcome.verdict.passed
            return Exit.GOOD if passed else Exit.NOT_BETTER
        case State.UNCERTAIN, _:
            return Exit.UNCERTAIN
        case _, InputError():
            return Exit.BAD_INPUT
        case State.ABORTED, error if not isinstance(error, AbortedByInterlock):
            return Exit.ABORTED
        case _:
            return Exit.DEVICE_FAILED


def show_end(outcome: Outcome, result: RunResult, folder: Path, *, quiet: bool) -> None:
    """The verdict in one sentence, or the error and the state of the cell (on stderr)."""
    state = fold(read_journal(folder))
    if outcome.state is State.FINISHED:
        if not quiet:
            _print_verdict(result.verdict, result.sentence or "Finished.")
            for line in result.lines:
                print(line)
            print(f"Run folder: {folder}")
        if pushed := table_line(state, folder, only_unproved=True):
            print(f"cellctl: {pushed}", file=sys.stderr)
        return
    error = errors_text(outcome.error) if isinstance(outcome.error, InputError) else str(outcome.error or "")
    ended = RunEnded(outcome.state.value, "", error, troubles=outcome.troubles, robot=outcome.robot)
    print("cellctl: " + "\n".join(RunEnd.of_event(folder, state, ended).lines(folder)), file=sys.stderr)


_STYLES = {
    "better": "bold green",
    "in control": "bold green",
    "no better": "bold yellow",
    "measure again": "bold yellow",
    "worse": "bold red",
    "recalibrate": "bold red",
}


def _print_verdict(verdict: str | None, sentence: str) -> None:
    """The verdict on stdout, coloured on a terminal."""
    from rich.console import Console

    style = _STYLES.get(verdict or "", "")
    Console(highlight=False, soft_wrap=True).print(sentence, style=style, markup=False)
