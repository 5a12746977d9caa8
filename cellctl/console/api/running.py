"""A run: status, tree, log, and the commands that act on it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from pathlib import Path
from typing import Annotated, TypeVar

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field, StringConstraints

from cellctl.console import commands
from cellctl.console.api.answers import COMMANDS, READS, Commander, Refused, RunName
from cellctl.console.live import LogLine, Snapshot, whole_log
from cellctl.console.shared import console
from cellctl.engine.step_tree import Node
from cellctl.files import InputError
from cellctl.journal import OperatorAction
from cellctl.operations.run_control import question_of
from cellctl.operations.run_list import RunEnd
from cellctl.operations.run_notes import LONGEST, Note, notes_of

router = APIRouter(prefix="/api/runs/{name}", tags=["run"])

T = TypeVar("T")


class StatusOut(BaseModel):
    """A run at one moment."""

    run: str
    version: int = Field(description="Rises with each change of the run")
    state: str = Field(description="State of the engine, or `cut off while …`")
    active: bool = Field(description="Whether a process executes it now")
    step: str = Field(description="Path of the step in progress; empty: none")
    phase: str = Field(description="Title of the step in progress")
    done: int = Field(description="Finished steps")
    total: int = Field(description="Steps, as far as the loops' lists are known yet")
    left_s: float | None = Field(description="Time left, s; null: not known yet")
    message: str = Field(description="Last line for the operator")
    confirm: str = Field(description="Text that waits to be confirmed; empty: none")
    held_by: str = Field(description="Why the run is paused; empty: it is not")
    broken: list[str] = Field(description="Interlocks that do not hold")
    verdict: str = Field(description="`better`, `no better`, …; empty: none yet")
    sentence: str = Field(
        description="How it ended, with cause, cure, state of robot and data; else its verdict; empty: none yet"
    )
    problem: str = Field(description="Why it ended early, or why its journal cannot be read; empty: neither")
    cure: str = Field(description="What to do about the problem; empty: nothing")


class Reason(BaseModel):
    """Why a run is paused or aborted."""

    reason: str = Field(default="", max_length=500)


class Confirmed(BaseModel):
    """The step that an operator confirms: `step` of the status whose `confirm` was read."""

    step: Annotated[str, StringConstraints(min_length=1, max_length=500)]


class Retry(BaseModel):
    """Whether a person checked the cell; needed where `question` of /retry is not empty."""

    acknowledged: bool = False


class Question(BaseModel):
    """What a person has to check before a run is continued; empty: nothing."""

    question: str


class Done(BaseModel):
    """A command that the run took."""

    run: str
    action: str
    operator: str


@router.get("/status", responses=READS)
async def status(name: RunName) -> StatusOut:
    """State, step, progress, time left, what the run waits for, and the verdict."""
    return status_out(await _snapshot(name))


@router.get("/tree", responses=READS)
async def tree(name: RunName) -> Node | None:
    """The procedure as a tree with the state of each step; null: this version cannot read the procedure."""
    return (await _snapshot(name)).tree


@router.get("/log", responses=READS)
async def log(
    name: RunName,
    kind: Annotated[str, Query(description="Kind of the lines, see `LogLine`; empty: all")] = "",
    text: Annotated[str, Query(description="Text in line, step or person; empty: all")] = "",
    whole: Annotated[bool, Query(description="The whole log, not the latest 1000 lines")] = False,
) -> list[LogLine]:
    """The latest 1000 lines of the log, or the whole log; those of this kind and with this text."""
    folder = _folder(name)
    lines = await asyncio.to_thread(whole_log, folder) if whole else (await _snapshot(name)).log
    return [line for line in lines if line.fits(kind, text)]


@router.post("/pause", responses=COMMANDS)
async def pause(name: RunName, why: Reason, operator: Commander) -> Done:
    """Pause before the next step. This is no safety stop."""
    return await _act(commands.act_on(operator, _folder(name), "pause", why.reason), name)


@router.post("/resume", responses=COMMANDS)
async def resume(name: RunName, operator: Commander) -> Done:
    """Continue a paused run, unless an interlock forbids it."""
    return await _act(commands.act_on(operator, _folder(name), "resume"), name)


@router.post("/abort", responses=COMMANDS)
async def abort(name: RunName, why: Reason, operator: Commander) -> Done:
    """Cancel the step in progress and clean up. This is no safety stop."""
    return await _act(commands.act_on(operator, _folder(name), "abort", why.reason), name)


@router.post("/confirm", responses=COMMANDS)
async def confirm(name: RunName, confirmed: Confirmed, operator: Commander) -> Done:
    """Confirm the step that the run waits at; refused where it is not the named one."""
    return await _act(commands.act_on(operator, _folder(name), "confirm", confirmed.step), name)


@router.post("/reset", responses=COMMANDS)
async def reset(name: RunName, operator: Commander) -> Done:
    """Press the reset of the run's simulated cell: emergency stop, guard, the robot's messages. A real cell refuses."""
    return await _act(commands.act_on(operator, _folder(name), "reset"), name)


@router.get("/retry", responses=READS)
async def question(name: RunName) -> Question:
    """What a person has to check before the run is continued at the step that it did not finish."""
    return Question(question=await asyncio.to_thread(question_of, _folder(name)))


@router.post("/retry", responses=COMMANDS)
async def retry(name: RunName, how: Retry, operator: Commander) -> Done:
    """Continue a run that ended early at the step that it did not finish, in a process of its own."""
    await _now(commands.retry(operator, _folder(name), acknowledged=how.acknowledged))
    return Done(run=name, action="retry", operator=operator.name)


class NoteText(BaseModel):
    """What a person notes on a run."""

    text: Annotated[str, StringConstraints(min_length=1, max_length=LONGEST)]


@router.get("/notes", responses=READS)
async def notes(name: RunName) -> list[Note]:
    """The notes of people on the run, the oldest first."""
    return await asyncio.to_thread(notes_of, _folder(name))


@router.post("/notes", responses=COMMANDS)
async def note(name: RunName, text: NoteText, operator: Commander) -> Note:
    """Note something on the run; it is kept beside the journal, with person and time."""
    return await _now(commands.note(operator, _folder(name), text.text))


def status_out(found: Snapshot) -> StatusOut:
    """A snapshot for JSON."""
    now, broken = found.status, found.problem
    end = None if broken else RunEnd.of(found.folder, found.state, running=found.active)
    return StatusOut(
        run=found.run,
        version=found.version,
        state=now.state,
        active=found.active,
        step=now.step,
        phase=now.phase,
        done=now.done,
        total=now.total,
        left_s=now.left_s,
        message=now.message,
        confirm=now.confirm,
        held_by=now.held_by,
        broken=list(now.broken),
        verdict=found.verdict,
        sentence=end.sentence if end else found.sentence,
        problem=str(broken) if broken else end.problem if end else "",
        cure=broken.cure if broken else end.cure if end else "",
    )


async def _snapshot(name: str) -> Snapshot:
    _folder(name)
    return await console().live.snapshot(name)


def _folder(name: str) -> Path:
    try:
        return commands.folder_of(name)
    except LookupError:
        raise Refused(404, f"there is no run '{name}'", "see /api/runs") from None


async def _act(work: Awaitable[OperatorAction], name: str) -> Done:
    done = await _now(work)
    return Done(run=name, action=done.action, operator=done.operator)


async def _now(work: Awaitable[T]) -> T:
    """Await a command; a refused one is a conflict with the run's state (409)."""
    try:
        return await work
    except InputError as error:
        raise Refused(409, error.problems[0].what, error.problems[0].cure) from error
