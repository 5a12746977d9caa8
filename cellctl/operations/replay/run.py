"""Replays a run: repeats its computing steps and compares all results with the journal."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, final

from cellctl.files import InputError, Problem, canonical_json
from cellctl.journal import Entry, RunResumed, RunStarted, fold, journal_in, read_journal
from cellctl.operations.provenance import changed_sources, code_hash, versions
from cellctl.operations.replay.artefacts import ArtefactReplay
from cellctl.operations.replay.difference import TOLERANCE, Agreement, json_differences, same_within_tolerance
from cellctl.operations.replay.recompute import Recomputed, recomputed, sources_of
from cellctl.procedure import StepRegistry


@final
@dataclass(frozen=True, slots=True)
class StepReplay:
    """An attempt at a computing step. differences: of its result and rows from the record; why: reasons.

    agreement: of result and rows with the record.
    """

    step: str
    attempt: int
    do: str
    rows: int
    differences: tuple[str, ...]
    agreement: Agreement
    why: tuple[str, ...] = ()


@final
@dataclass(frozen=True)
class Replay:
    """The result of a replay. changed: differences from the run in versions, computer and code.

    contents: name → content of the files that the replay made, the latest of each name.
    """

    run: str
    changed: tuple[str, ...]
    steps: tuple[StepReplay, ...]
    artefacts: tuple[ArtefactReplay, ...]
    contents: Mapping[str, bytes]

    @property
    def agreement(self) -> Agreement:
        """The least of all repeated results and files; a file that was changed in the run folder is not equal."""
        found = {*(step.agreement for step in self.steps), *(file.confirmed for file in self.artefacts)}
        return next((worst for worst in reversed(Agreement) if worst in found), Agreement.EXACT)

    def to_json(self) -> dict[str, Any]:
        """As `cellctl replay --json` shows it."""
        return {
            "run": self.run,
            "equal": self.agreement is Agreement.EXACT,
            "agreement": self.agreement,
            "tolerance": TOLERANCE,
            "changed": list(self.changed),
            "artefacts": [
                {**asdict(each), "equal": each.confirmed is Agreement.EXACT, "agreement": each.confirmed}
                for each in self.artefacts
            ],
            "steps": [{**asdict(each), "equal": each.agreement is Agreement.EXACT} for each in self.steps],
        }


def replay_run(run: Path, tell: Callable[[str], None] = lambda _: None, registry: StepRegistry | None = None) -> Replay:
    """Replay the run in folder `run` (or of that journal), also one that is not finished. Changes nothing there.

    It reads the journal alone; the files in the run folder are only compared. `tell`: called with the name of each step
    before it is computed; registry: the kinds of steps, None: those installed. Raises JournalError without a
    journal, InputError if it lacks sources.
    """
    entries = list(read_journal(run))
    state = fold(entries)
    if state.started is None:
        what = "was cut off before it began: it has computed nothing"
        raise InputError(Problem(str(run), 0, 0, what, "replay another run"))
    with sources_of(state.started) as sources:
        steps = asyncio.run(recomputed(entries, sources, registry or StepRegistry.installed(), tell))
    changed = tuple(_changed(entries))
    found = _compared(steps, changed, journal_in(run).parent)
    contents = {name: content for step in steps for name, content in step.now.contents.items()}
    return Replay(state.name, changed, *found, contents)


def _compared(
    steps: Sequence[Recomputed], changed: tuple[str, ...], folder: Path
) -> tuple[tuple[StepReplay, ...], tuple[ArtefactReplay, ...]]:
    last = {name: step for step in steps for name in step.recorded.artefacts.keys() | step.now.artefacts.keys()}
    compared: list[StepReplay] = []
    artefacts: list[ArtefactReplay] = []
    for step in steps:
        before = [each.name for each in artefacts if not each.replayed_equal]
        why = tuple(changed) or (() if before else (_UNEXPLAINED,))
        why += tuple(f"{name}, made before it, differs as well" for name in dict.fromkeys(before))
        tolerant = bool(changed)  # on the same computer the same code gives the same bytes, or something is wrong
        compared.append(_step(step, why, tolerant))
        names = {**step.recorded.artefacts, **step.now.artefacts}
        for name in names:
            place = folder if last[name] is step else None
            artefacts.append(
                ArtefactReplay.of(
                    name, step.recorded, step.now, place, why, compared[-1].agreement if tolerant else None
                )
            )
    return tuple(compared), tuple(artefacts)


_UNEXPLAINED = (
    "versions, computer and code are those of the run: this step does not compute the same twice; please report it"
)


def _step(step: Recomputed, why: tuple[str, ...], tolerant: bool) -> StepReplay:
    ended, recorded, now = step.recorded.ended, step.recorded.values, step.now.values
    differences = _differences(recorded, now)
    agreement = Agreement.DIFFERENT if differences else Agreement.EXACT
    if differences and tolerant and same_within_tolerance(canonical_json(recorded), canonical_json(now)):
        agreement = Agreement.WITHIN_TOLERANCE
    return StepReplay(
        step=ended.step,
        attempt=ended.attempt,
        do=step.do,
        rows=len(recorded["rows"]),
        differences=tuple(differences),
        agreement=agreement,
        why=why if differences else (),
    )


def _differences(recorded: dict[str, Any], now: dict[str, Any]) -> list[str]:
    rows, others = recorded["rows"], now["rows"]
    ends = ("outcome", "result", "failure")
    differences = [text for key in ends for text in json_differences(recorded[key], now[key], key)]
    if [row["kind"] for row in rows] != [row["kind"] for row in others]:
        return [*differences, *json_differences([row["kind"] for row in rows], [row["kind"] for row in others], "rows")]
    for row, other in zip(rows, others, strict=True):
        differences += json_differences(row["data"], other["data"], row["kind"])
    return differences


def _changed(entries: Sequence[Entry]) -> list[str]:
    """The differences from the run's setting, also after a resume: `numpy 2.3.1 → 2.4.6`."""
    now, code = versions(), code_hash()
    made = [entry.event for entry in entries if isinstance(entry.event, RunStarted | RunResumed)]
    pairs = [
        (name, before, now.get(name, "not installed")) for event in made for name, before in event.versions.items()
    ]
    changed = [f"{name} {before} → {after}" for name, before, after in pairs if before != after]
    if any(event.code_sha256 != code for event in made):
        files = next((event.sources for event in made if isinstance(event, RunStarted)), {})
        changed.append(f"the code of cellctl, its drivers or steps has changed{changed_sources(files)}")
    return list(dict.fromkeys(changed))
