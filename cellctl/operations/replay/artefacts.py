"""Files that a run made, in the journal, the replay and the run folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Self, final

from cellctl.files import sha256_of
from cellctl.operations.replay.difference import Agreement, FirstDifference, same_within_tolerance
from cellctl.operations.replay.recompute import Attempt
from cellctl.records import ArtefactRow


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
    why: reasons for what differs; agreement: of the replay's bytes with the journal's.
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
        agreement = Agreement.DIFFERENT if differs else Agreement.EXACT
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

    @property
    def confirmed(self) -> Agreement:
        """How the replay agrees with the journal, and the file in the run folder, if present, with both."""
        return Agreement.DIFFERENT if self.folder is FolderFile.CHANGED else self.agreement


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
