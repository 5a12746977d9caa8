"""How a run ended early, in the same words for command line, console and API: cause, cure, state of robot and data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self, final

from cellctl.journal import Outcome, RunEnded, RunState
from cellctl.operations.results import table_line

_FAILED = (Outcome.FAILED, Outcome.TIMED_OUT)
_HEADS = {"uncertain": "Uncertain state, look at the cell"}
_NOT_CLEAN = "the clean-up did not succeed"
_CURE = "    "
"""So begins a line of an error's text that says what to do."""

_CUT_OFF = "its process ended without an end of the run"
_UNKNOWN = "what the robot did last is not known: look at it before anything else moves"


@final
@dataclass(frozen=True, slots=True)
class RunEnd:
    """The end of a run that did not finish.

    state: the engine's, or `cut off while …`. error: its text, causes and cures line by line. steps: paths of the steps
    that failed. troubles: what the clean-up did not achieve. robot: its state; empty in older journals. table: of a
    table that was pushed; empty without one. again: how the run is continued. measurements: how many are recorded.
    """

    state: str
    error: str
    steps: tuple[str, ...]
    troubles: tuple[str, ...]
    robot: str
    table: str
    again: str
    measurements: int

    @classmethod
    def of(cls, folder: Path, state: RunState, *, running: bool) -> Self | None:
        """Of the run in `folder`; None as long as it is running, and if it finished."""
        if state.ended:
            return None if state.ended.state == "finished" else cls.of_event(folder, state, state.ended)
        if running or state.started is None:
            return None
        robot = _UNKNOWN if state.uncertain else ""
        return cls.of_event(folder, state, RunEnded(state.state_if(running=False), "", _CUT_OFF, robot=robot))

    @classmethod
    def of_event(cls, folder: Path, state: RunState, ended: RunEnded) -> Self:
        """By the event of its end, which a full disk may have kept out of the journal."""
        procedure = state.started.procedure.path if state.started else "PROCEDURE"
        acknowledged = " --acknowledge" * (ended.state == "uncertain" or state.uncertain)
        again = f"`cellctl run {procedure} --resume {folder.name}{acknowledged}`"
        return cls(
            state=ended.state,
            error=ended.reason or _NOT_CLEAN * (ended.state == "uncertain"),
            steps=tuple(step.step for step in state.steps.values() if step.outcome in _FAILED),
            troubles=ended.troubles,
            robot=ended.robot,
            table=table_line(state, folder),
            again=again,
            measurements=state.measurements,
        )

    @property
    def problem(self) -> str:
        """Every cause, in one line."""
        causes = [line for line in self.error.split("\n") if line and not line.startswith(_CURE)]
        found = ""
        for cause in [*causes, *self.troubles]:
            found += ("" if not found else " " if found.endswith(":") else "; ") + cause.partition("\n")[0].strip()
        return found

    @property
    def cure(self) -> str:
        """What to do, in one line: the cures of the causes, and how the run is continued."""
        lines = [line for text in (self.error, *self.troubles) for line in text.split("\n")]
        cures = [line.strip().removesuffix(".") for line in lines if line.startswith(_CURE)]
        return "; ".join(dict.fromkeys([*cures, f"continue it with {self.again}"]))

    @property
    def data(self) -> str:
        """What is recorded."""
        return f"{self.measurements} measurements are recorded"

    @property
    def sentence(self) -> str:
        """The headline: state, cause, cure, robot, table and data."""
        head = _HEADS.get(self.state, self.state.capitalize())
        first = f"{head}: {self.problem}" if self.problem else head
        return " ".join(_sentence(text) for text in (first, self.cure, self.robot, self.table, self.data) if text)

    def lines(self, folder: Path) -> list[str]:
        """For the terminal."""
        lines = [f"run {self.state}: {self.error}"]
        lines += [f"    in step {step}" for step in self.steps]
        lines += [f"    {text}" for text in (*self.troubles, self.robot, self.table) if text]
        return [*lines, f"    {self.data} in {folder}", f"    continue it with {self.again}"]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "?", "!")) else ".")
