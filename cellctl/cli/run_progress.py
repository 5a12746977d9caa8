"""A run on the terminal: the cell file's warnings, progress with the time left, confirmations, the last lines."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, final

from cellctl.cli.arguments import in_minutes, write_json
from cellctl.cli.exit_codes import SHOWN, Exit, errors_text
from cellctl.devices.cell import Cell
from cellctl.engine import AbortedByInterlock, Mailbox, NobodyWatching, Operator, Outcome, Passes, State, Watcher
from cellctl.files import InputError
from cellctl.journal import (
    DevicesConnected,
    JournalError,
    KnownEvent,
    RunEnded,
    RunResult,
    Said,
    StateChanged,
    StepEnded,
    StepStarted,
    fold,
    read_journal,
)
from cellctl.operations.campaign import Campaign
from cellctl.operations.run_folder import table_line
from cellctl.operations.run_indexing import tell_existing_index
from cellctl.operations.run_list import RunEnd
from cellctl.procedure import phase_titles
from cellctl.report import write_report

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


def show_warnings(cell: Cell) -> None:
    """Print allowed but probably unintended values in the cell file, if any."""
    count = len(cell.warnings)
    if count:
        more = [f"… and {count - SHOWN} more"] if count > SHOWN else []
        text = "\n".join([*map(str, cell.warnings[:SHOWN]), *more])
        print(f"cellctl: {count} warning{'s' * (count > 1)}\n{text}", file=sys.stderr)


@contextmanager
def progress(campaign: Campaign, folder: Path, *, quiet: bool) -> Iterator[Watcher]:
    """A watcher that shows the run: a live bar on a terminal, else a line for each tenth; no output when quiet."""
    if quiet:
        yield NobodyWatching()
        return
    from rich.console import Console  # only for people: 0.1 s
    from rich.progress import (  # only for people: 0.1 s
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    console = Console(highlight=False, soft_wrap=True)
    kind = "simulated" if campaign.cell.simulated else "REAL"
    console.print(f"{campaign.procedure.title}\ncell: {campaign.cell.name} ({kind})\nrun:  {folder}")
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=console, transient=True, disable=not sys.stdout.isatty()) as bar:
        yield RunDisplay(
            console, bar, phase_titles(campaign.procedure, campaign.registry), Passes(campaign.expected_passes)
        )


_GO_ON = "remove the cause, if any, and acknowledge messages of the robot; then `cellctl continue`, or `cellctl abort`"


@final
class RunDisplay:
    """Shows events as lines above one bar for the whole run."""

    def __init__(self, console: Console, bar: Progress, titles: Mapping[str, str], passes: Passes) -> None:
        self._console, self._bar, self._titles, self._passes = console, bar, titles, passes
        self._task = bar.add_task("starting", total=passes.total or None, left="")
        self._title, self._tenth, self._total = "starting", 0, passes.total

    def event(self, event: KnownEvent) -> None:
        """Show what an operator needs of it."""
        match event:
            case DevicesConnected(identities):
                for name, identity in identities.items():
                    firmware = f", {identity['firmware']}" if identity["firmware"] else ""
                    self._console.print(f"  {name}: {identity['model']}, serial {identity['serial']}{firmware}")
            case StateChanged(after="connecting"):
                self._console.print("connecting …")
            case StateChanged(after="paused", reason=reason):
                self._console.print(f"paused: {reason}\n    {_GO_ON}")
            case StateChanged(after="cleaning", reason=reason) if reason:
                self._console.print(f"cleaning: {reason}")
            case Said(text=text):
                self._console.print(f"  {text}")
            case StepStarted(step=step):
                self._title = self._titles.get(step.rpartition(".")[2], self._title)
                if "[" in step:
                    self._passes.step_begins()
                self._show()
            case _:
                pass

    def loop(self, path: str, index: int, count: int) -> None:
        """Show the progress; off a terminal, a line for each tenth."""
        self._passes.loop(path, index, count)
        self._show()

    def _show(self) -> None:
        done, total, left_s = self._passes.done, self._passes.total, self._passes.left_s
        left = "" if left_s is None else f"{in_minutes(left_s)} left"
        self._bar.update(self._task, description=self._title, completed=done, total=total or None, left=left)
        tenth = 10 * done // total if total else 0
        if total > self._total:  # a further loop has begun: its tenths count
            self._total, self._tenth = total, tenth
        if self._bar.disable and tenth > self._tenth:
            self._tenth = tenth
            self._console.print(f"  {self._title}: {done} of {total}{', ' + left if left else ''}")


_HOW = "press Enter to confirm, Ctrl-C to abort; from another terminal: `cellctl confirm`"


def interactive() -> bool:
    """Whether an operator can be asked: standard input and error are a terminal that the system can monitor."""
    return os.name == "posix" and sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


@final
class ConfirmingAtTerminal:
    """A watcher that passes everything on to `shown`, and reads the terminal while a `confirm` step waits."""

    def __init__(self, shown: Watcher, mailbox: Mailbox) -> None:
        self._shown, self._mailbox = shown, mailbox
        self._waiting = ""

    def event(self, event: KnownEvent) -> None:
        """Pass the event on; read from a `confirm` step's text to the end of the step."""
        self._shown.event(event)
        match event:
            case StepStarted(step=step, do="confirm"):
                self._waiting = step
            case Said(step=step) if step and step == self._waiting:
                self._shown.event(Said(_HOW))
                asyncio.get_running_loop().add_reader(sys.stdin.fileno(), self._read)
            case StepEnded(step=step) if step == self._waiting:
                self._leave()
            case _:
                pass

    def loop(self, path: str, index: int, count: int) -> None:
        """Pass it on."""
        self._shown.loop(path, index, count)

    def _read(self) -> None:
        terminal = sys.stdin.fileno()
        if os.getpgrp() != os.tcgetpgrp(terminal):  # in the background: reading would stop this process
            self._leave()
            return
        line = os.read(terminal, 4096)
        if not line:
            self._leave()
        elif line.strip().lower() in (b"", b"y", b"yes"):
            self._mailbox.confirm(Operator.here("terminal"))
        else:
            self._shown.event(Said(_HOW))

    def _leave(self) -> None:
        self._waiting = ""
        asyncio.get_running_loop().remove_reader(sys.stdin.fileno())


def keep_json(result: RunResult, target: str | None, folder: Path) -> None:
    """`write_json` of a run's result. A failure is only printed on stderr: the JSON can be written again."""
    try:
        write_json(result.to_json(), target)
    except OSError as error:
        again = f"have it again with: cellctl show {folder} --json FILE"
        print(f"cellctl: no JSON: {target}: {error.strerror or error}\n    {again}", file=sys.stderr)


def report_of(folder: Path) -> None:
    """Write the run's report. A failure is only printed on stderr: the report can be rebuilt."""
    try:
        write_report(folder)
        tell_existing_index(folder)
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
    "agree": "bold green",
    "not known": "bold yellow",
    "disagree": "bold red",
    "no better": "bold yellow",
    "not met": "bold yellow",
    "measure again": "bold yellow",
    "worse": "bold red",
    "recalibrate": "bold red",
}


def _print_verdict(verdict: str | None, sentence: str) -> None:
    """The verdict on stdout, coloured on a terminal."""
    from rich.console import Console  # only for people: 0.1 s

    style = _STYLES.get(verdict or "", "")
    Console(highlight=False, soft_wrap=True).print(sentence, style=style, markup=False)
