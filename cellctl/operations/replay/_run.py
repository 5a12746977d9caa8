"""Replays a run: repeats its computing steps and compares results and files with the journal, within a tolerance.

Linear algebra libraries choose their code by the processor. The order of their sums differs, so the last digits do, and
what is a rounding error of zero on one processor has any digits on another. Measured on campaigns and fits, between the
OpenBLAS kernels Nehalem, Haswell, Zen and SkylakeX: at most 1e-8 (mm, degrees). `ABSOLUTE` is ten times that, and far
below what a robot can do; without `RELATIVE` large numbers would differ by their 53 bits alone.
"""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Final, Self, final

from pydantic import Field, computed_field

from cellctl.files import InputError, Problem, canonical_json, sha256_of
from cellctl.journal import Entry, RunResumed, RunStarted, check_journal, fold, journal_in, read_journal
from cellctl.operations.launch import changed_sources, code_hash, versions
from cellctl.operations.replay._recompute import Attempt, Recomputed, recomputed, sources_of
from cellctl.procedure import StepRegistry
from cellctl.records import ArtefactRow

_EXCERPT: Final = 40
"""Number of bytes of a line that are shown from the difference on."""

_ABSENT: Final = object()

ABSOLUTE: Final = 1e-7
RELATIVE: Final = 1e-5
"""Two numbers are within the tolerance if they differ by no more than ABSOLUTE + RELATIVE × the larger of the two."""

WRITTEN_JOINTS_MM: Final = 5e-5
"""Lengths that follow from joints as a table writes them, with 6 decimals: where the digits beyond are a tie, another
processor writes the neighbour, and 1e-6° moves the TCP of an arm of 3 m by 5e-5 mm."""

_FROM_WRITTEN_JOINTS: Final = ('"expected_mm":', '"predicted_after_mm":')

TOLERANCE: Final = (
    f"numbers agree to {ABSOLUTE:g} or {RELATIVE:g} of their size, expected errors at written joints to "
    f"{WRITTEN_JOINTS_MM:g} mm, all else is equal"
)

_TOKEN: Final = re.compile(r"(\b[0-9a-f]{64}\b|-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)")
"""A SHA-256 or a number; `re.split` puts these at the odd places."""


class Agreement(StrEnum):
    """How a replayed result agrees with the record."""

    EXACT = "equal to the byte"
    WITHIN_TOLERANCE = "equal within the stated tolerance (other processor or library)"
    DIFFERENT = "not equal"


def close(before: float, now: float, absolute: float = ABSOLUTE) -> bool:
    """Whether two numbers are within the tolerance."""
    return math.isclose(before, now, rel_tol=RELATIVE, abs_tol=absolute)


def same_within_tolerance(before: str, now: str) -> bool:
    """Whether two texts (JSON, CSV) differ in numbers within the tolerance alone.

    A SHA-256 stands for a content that is compared by itself, such as the model's in a table: another one is accepted
    where it takes the same place throughout.
    """
    hashes: dict[str, str] = {}
    name = ""
    for place, (one, other) in enumerate(zip_longest(_TOKEN.split(before), _TOKEN.split(now))):
        if place % 2 == 0:
            name = one or ""
        if one == other:
            continue
        if one is None or other is None or place % 2 == 0:
            return False
        if len(one) == len(other) == _SHA256:
            if hashes.setdefault(one, other) != other:
                return False
        else:
            absolute = WRITTEN_JOINTS_MM if name.endswith(_FROM_WRITTEN_JOINTS) else ABSOLUTE
            if not ({*".eE"} & {*one, *other}) or not close(float(one), float(other), absolute):
                return False  # counts are equal, or not
    return True


_SHA256: Final = 64


@final
@dataclass(frozen=True, slots=True)
class FirstDifference:
    """The first byte (from 1) that differs and its line (from 1); the text from there on, before and now."""

    byte: int
    line: int
    before: str
    now: str

    @classmethod
    def of(cls, before: bytes, now: bytes) -> Self | None:
        """The first difference of `now` from `before`; None if they are equal."""
        if before == now:
            return None
        pairs = enumerate(zip(before, now, strict=False))
        at = next((place for place, (one, other) in pairs if one != other), min(len(before), len(now)))
        return cls(at + 1, before.count(b"\n", 0, at) + 1, _excerpt(before, at), _excerpt(now, at))

    def __str__(self) -> str:
        return f"first at byte {self.byte} (line {self.line}): {self.before} → {self.now}"


def _excerpt(content: bytes, at: int) -> str:
    """The text from `at` to the end of its line, shortened if long; a number is shown from its beginning."""
    while 0 < at < len(content) and content[at - 1 : at] in b"0123456789.-+e":
        at -= 1
    line = content[at : at + _EXCERPT].split(b"\n", 1)[0].decode("utf-8", "replace")
    return repr(line) if at < len(content) else "the end of the file"


def json_differences(before: Any, now: Any, place: str) -> list[str]:
    """All differences of `now` from `before`, each as `place.key[3]: old → new`, in order."""
    return list(_value_differences(before, now, place))


def _value_differences(before: Any, now: Any, place: str) -> Iterator[str]:
    match before, now:
        case dict(), dict():
            for key in sorted(before.keys() | now.keys()):
                inner = f"{place}.{key}"
                yield from _value_differences(before.get(key, _ABSENT), now.get(key, _ABSENT), inner)
        case list(), list():
            if len(before) != len(now):
                yield f"{place}: {len(before)} elements → {len(now)}"
            for index, (one, other) in enumerate(zip(before, now, strict=False)):
                yield from _value_differences(one, other, f"{place}[{index}]")
        case _ if type(before) is not type(now) or before != now:
            yield f"{place}: {_short(before)} → {_short(now)}"


def _short(value: Any) -> str:
    if value is _ABSENT:
        return "absent"
    text = repr(value)
    return text if len(text) <= 2 * _EXCERPT else f"{text[: 2 * _EXCERPT]}…"


class FolderFile(StrEnum):
    """The file in the run folder, compared with its hash in the journal."""

    AS_RECORDED = "as recorded"
    CHANGED = "changed"
    MISSING = "missing"
    REPLACED = "replaced"
    """A later step of the run wrote a file of this name."""


@final
@dataclass(frozen=True, slots=True)
class ArtefactReplay:
    """One file: its SHA-256 (hex) in the journal and in the replay, None if it was not made.

    first: first difference of the replayed file from the one in the run folder, unless both differ from the journal;
    why: reasons for what differs; agreement: of the replay's bytes with the journal's, and of the file in the run
    folder, if present, with both.
    """

    name: str
    step: str
    attempt: int
    recorded: str | None
    replayed: str | None
    folder: FolderFile
    first: FirstDifference | None
    agreement: Agreement
    why: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, name: str, recorded: Attempt, now: Attempt, folder: Path | None, why: Sequence[str], step: Agreement | None
    ) -> Self:
        """The file `name` of an attempt; folder: the run folder, None if a later step wrote that file again.

        why: reasons for different bytes that are known before the comparison; step: agreement of the step's result and
        rows, by which a file is judged whose own bytes are gone; None if not even the last digits may differ.
        """
        row, content = recorded.artefacts.get(name), now.contents.get(name)
        there = _content(folder / name) if folder else None
        state = _state(row, there) if folder else FolderFile.REPLACED
        replayed = None if content is None else sha256_of(content)
        differs = (row.sha256 if row else None) != replayed
        known = there is not None and (state is FolderFile.AS_RECORDED or not differs)  # else: of two differences one
        first = FirstDifference.of(there, content) if known and there is not None and content is not None else None
        agreement = Agreement.DIFFERENT if differs or state is FolderFile.CHANGED else Agreement.EXACT
        if differs and row and content is not None and step not in (None, Agreement.DIFFERENT):
            gone = state in (FolderFile.MISSING, FolderFile.REPLACED)
            if gone or (state is FolderFile.AS_RECORDED and there is not None and _same(there, content)):
                agreement = Agreement.WITHIN_TOLERANCE
        reasons = [*(why if differs else ()), *_about_folder(state, differs)]
        return cls(
            name=name,
            step=recorded.ended.step,
            attempt=recorded.ended.attempt,
            recorded=row.sha256 if row else None,
            replayed=replayed,
            folder=state,
            first=first,
            agreement=agreement,
            why=tuple(reasons),
        )

    @property
    def replayed_equal(self) -> bool:
        """Whether the replay's bytes have the hash in the journal."""
        return self.recorded == self.replayed

    @computed_field
    @property
    def equal(self) -> bool:
        """Whether all agree byte for byte."""
        return self.agreement is Agreement.EXACT


def _same(before: bytes, now: bytes) -> bool:
    return same_within_tolerance(before.decode("utf-8", "replace"), now.decode("utf-8", "replace"))


def _about_folder(state: FolderFile, differs: bool) -> list[str]:
    reasons = []
    if state is FolderFile.CHANGED:
        reasons.append("the file in the run folder was changed after the run")
    if differs and state is not FolderFile.AS_RECORDED:
        reasons.append("the run's own bytes are not in the run folder, so it cannot be said where they differ")
    return reasons


def _state(row: ArtefactRow | None, there: bytes | None) -> FolderFile:
    if there is None:
        return FolderFile.MISSING
    return FolderFile.AS_RECORDED if row and sha256_of(there) == row.sha256 else FolderFile.CHANGED


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


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

    @computed_field
    @property
    def equal(self) -> bool:
        """Whether they agree byte for byte."""
        return self.agreement is Agreement.EXACT


@final
@dataclass(frozen=True)
class Replay:
    """The result of a replay. agreement: the least of all repeated results and files; equal: it is exact.

    changed: differences from the run in versions, computer and code; edited: events of the journal that are not as they
    were written, as text: then the agreement is DIFFERENT. contents: name → content of the files that the
    replay made, the latest of each name; not in its JSON.
    """

    run: str
    equal: bool
    agreement: Agreement
    tolerance: str
    changed: tuple[str, ...]
    edited: tuple[str, ...]
    artefacts: tuple[ArtefactReplay, ...]
    steps: tuple[StepReplay, ...]
    contents: Annotated[Mapping[str, bytes], Field(exclude=True)] = field(default_factory=dict)


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
    compared, files = _compared(steps, changed, journal_in(run).parent)
    edited = check_journal(run).changed
    found = {*(step.agreement for step in compared), *(file.agreement for file in files)}
    found |= {Agreement.DIFFERENT} if edited else set()
    agreement = next((worst for worst in reversed(Agreement) if worst in found), Agreement.EXACT)
    contents = {name: content for step in steps for name, content in step.now.contents.items()}
    return Replay(
        state.name, agreement is Agreement.EXACT, agreement, TOLERANCE, changed, edited, files, compared, contents
    )


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
    differences = _record_differences(recorded, now)
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


def _record_differences(recorded: dict[str, Any], now: dict[str, Any]) -> list[str]:
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
