"""`cellctl doctor --commission`: the steps of a commissioning at the terminal, and the page of their record."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from pathlib import Path
from typing import final

import typer

from cellctl.cli.arguments import write_json
from cellctl.cli.exit_codes import Exit
from cellctl.cli.run_progress import interactive
from cellctl.devices.cell import Cell, ClockMode
from cellctl.devices.commissioning_record import CellRecord, StepRecord, load_record, record_file
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem, write_atomically
from cellctl.operations.commissioning import CommissionedCell, Confirmation, commission
from cellctl.operations.results import as_json
from cellctl.report import commissioning_page

_NO = ("", "n", "no", "q")
_NO_NAMES = ("y", "yes", "ok")


def commission_cell(
    cell: Cell,
    drivers: DriverRegistry,
    operator: str,
    *,
    seed: int | None,
    clock: ClockMode | None,
    motion: bool,
    yes: bool,
    page: Path | None,
    json_: str | None,
) -> None:
    """Run the steps that are due. Raises typer.Exit, the error that ended a step."""
    if not yes and not interactive():
        cure = "run it at the cell's terminal; or give --yes, which confirms no motion of a real robot"
        raise InputError(Problem("this call", 0, 0, "can ask nobody: standard input is no terminal", cure))
    signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGINT))  # a closed terminal ends it as Ctrl-C
    attendant = _AtTerminal(operator, yes=yes, simulated=cell.simulated, to_stderr=json_ == "-")
    done = asyncio.run(commission(cell, drivers, attendant, seed=seed, clock=clock, motion=motion))
    attendant.show(f"\n{_summary(done, motion=motion)}\nrecord: {done.file}")
    write_json(as_json(done.record), json_)
    if page:
        write_atomically(page, commissioning_page(done.record))
        attendant.show(f"page: {page}")
    if done.error:
        raise done.error
    raise typer.Exit(_exit_of(done.record, motion=motion))


def write_page(cell: Cell, page: Path) -> None:
    """The page of the record as it is. Raises InputError if there is none."""
    file = record_file(cell.path)
    record = load_record(file, cell.name, simulated=cell.simulated)
    if record is None:
        what = f"has no record of a commissioning in {file}"
        raise InputError(cell.document.problem((), what, f"cellctl doctor {cell.path} --commission"))
    write_atomically(page, commissioning_page(record))


def _left(record: CellRecord, *, motion: bool) -> list[StepRecord]:
    return [step for step in record.steps if step.state != "passed" and (motion or not step.moves)]


def _exit_of(record: CellRecord, *, motion: bool) -> Exit:
    return Exit.NOT_BETTER if _left(record, motion=motion) else Exit.GOOD


def _summary(done: CommissionedCell, *, motion: bool) -> str:
    record = done.record
    passed = sum(step.state == "passed" for step in record.steps)
    text = f"{passed} of {len(record.steps)} steps passed"
    if left := _left(record, motion=motion):
        return f"{text}; the next call goes on at {left[0].id}"
    return text if passed == len(record.steps) else f"{text}; those that move are left"


@final
class _AtTerminal:
    """The attendant of a commissioning at this terminal; with `yes` it confirms what needs no person."""

    def __init__(self, operator: str, *, yes: bool, simulated: bool, to_stderr: bool) -> None:
        self._operator, self._yes, self._simulated, self._to_stderr = operator, yes, simulated, to_stderr

    def show(self, text: str, *, nl: bool = True) -> None:
        typer.echo(text, err=self._to_stderr, nl=nl)

    async def confirmed(self, step: StepRecord, number: int, count: int) -> Confirmation | None:
        """By the operator; of a step that moves a real robot by a name typed at the terminal alone."""
        self.show(f"\n{number} of {count}  {step.id}: {step.title}")
        self.show(f"    {step.does}\n    later steps rely on: {step.next_needs}")
        if self._yes and (self._simulated or not step.moves):
            return Confirmation(self._operator, "--yes")
        if not interactive():
            self.show("    it moves a real robot, and there is no terminal at which somebody could confirm that")
            return None
        return await self._by_name() if step.moves else await self._by_enter()

    async def asked(self, text: str) -> None:
        """Wait for Enter; with --yes, or without a terminal, the devices show whether it is done."""
        self.told(text)
        if interactive() and not self._yes:
            await self._typed("    Enter when done:")

    def told(self, text: str) -> None:
        """Show what is to be done."""
        self.show(f"    → {text}.")

    def ended(self, step: StepRecord) -> None:
        """Show the figures and the result."""
        wide = max((len(figure.title) for figure in step.figures), default=0)
        for figure in step.figures:
            mark = "" if figure.ok else "  ← outside"
            limit = f"   ({figure.limit})" if figure.limit else ""
            self.show(f"    {figure.title:{wide}}  {figure.text}{limit}{mark}")
        by = f", confirmed by {step.confirmed_by} ({step.via})" if step.confirmed_by else ""
        self.show(f"    {step.state}{by}")

    async def _by_enter(self) -> Confirmation | None:
        typed = await self._typed("    Enter begins, q ends here:")
        return Confirmation(self._operator, "terminal") if typed is not None and typed.lower() != "q" else None

    async def _by_name(self) -> Confirmation | None:
        """Every motion has the name of who lets it begin: a habitual Enter or yes does not."""
        while True:
            _forget_typed()
            typed = await self._typed("    IT MOVES. Type your name to let it begin, Enter ends here:")
            if typed is None or typed.lower() in _NO:
                return None
            if typed.lower() not in _NO_NAMES:
                return Confirmation(typed, "terminal")

    async def _typed(self, prompt: str) -> str | None:
        """A line from the terminal, while the devices' lines go on; None at its end."""
        self.show(f"{prompt} ", nl=False)
        loop, typed = asyncio.get_running_loop(), asyncio.Event()
        terminal = sys.stdin.fileno()
        loop.add_reader(terminal, typed.set)
        try:
            await typed.wait()
        finally:
            loop.remove_reader(terminal)
        line = os.read(terminal, 4096)
        return line.decode(errors="replace").strip() if line else None


def _forget_typed() -> None:
    """What was typed before a question is no answer to it."""
    import termios  # POSIX alone

    termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
