"""Mistakes of set-up end `cellctl fit` before anything is fitted: named with place, evidence and cure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cellctl.files import Document, InputError, Problem, load_yaml

if TYPE_CHECKING:
    from cellctl.calibration import Progress
    from cellctl.formats import Measurements
    from cellctl.setup_check import Change, ScaleError, SetupError, SpacingError, WideFit

NO_CHECK = "--no-check fits all the same, as if nothing were wrong: do not use such a model before you know the cause"


def refuse_setup_errors(
    document: Document, data: Path, measured: Measurements, artefact: Path | None, progress: Progress
) -> None:
    """Nothing, where `measured` goes together with the robot file `document`; else raises InputError.

    One Problem for each mistake, at its place in the robot file, the data set or the artefact's file, with the evidence
    ("A3 reversed: RMS 214 → 0.9 mm") and the cure. Where the rows cannot tell between explanations, all are there. Of a
    set-up that is sound otherwise, the certified distances that the rows deny; of one that nothing explains, that robot
    file and data do not belong together.
    """
    from cellctl.setup_check import check_setup, find_spacing_errors

    check_result = check_setup(measured.task, measured.robot.joint_map(), measured.readings, progress)
    found = check_result.errors
    files = {"data": str(data), "artefact": str(artefact or data)}
    several = len(found) > 1
    problems = [
        _problem(document, files, measured, error, change, _others(found, error) if several else "")
        for error in found
        for change in error.changes
    ]
    if check_result.wide_fit and check_result.wide_fit.unrelated:
        problems = [_unrelated(document, data, check_result.wide_fit)]
    if not problems:
        contradicted = find_spacing_errors(measured.task)
        problems = [_contradicted(each, artefact, _cure(each, several=len(contradicted) > 1)) for each in contradicted]
    if problems:
        raise InputError(problems, NO_CHECK)


def _unrelated(document: Document, data: Path, fit: WideFit) -> Problem:
    """Robot file and data do not belong together, by how much, and what may be the reason."""
    what = (
        f"robot file and data do not belong together: RMS {fit.left_mm:.3g} mm after a fit with wide tolerances, where "
        f"robots of this class are {fit.predicted_mm:.2g} mm off before any fit, and measurements shuffled against the "
        f"joints {fit.shuffled_mm:.3g} mm after it"
    )
    cure = f"is {document.file} the robot that was measured? does each row have the joints of its own measurement?"
    return Problem(str(data), 0, 0, what, cure)


def _cure(contradicted: SpacingError | ScaleError, *, several: bool) -> str:
    """What to look at, and that the rows cannot tell where they cannot."""
    from cellctl.setup_check import ScaleError

    if isinstance(contradicted, ScaleError):
        return "mm? another unit, or an artefact of another size? correct them or leave them out"
    cure = "mm? the right two points? correct it or leave it out"
    if several and not contradicted.certain:
        cure += " (these rows cannot tell which of the distances named is wrong)"
    return cure


def _contradicted(spacing: SpacingError | ScaleError, artefact: Path | None, cure: str) -> Problem:
    """The distance, or the first of those wrong together, at its place in the artefact's file, or as an option."""
    if artefact is not None:
        document = load_yaml(artefact)
        at: tuple[str, ...] = ("artefact",) if "artefact" in document.data else ()
        for index, said in enumerate((document.data[at[0]] if at else document.data).get("distances") or []):
            names = {point.partition("@")[0] for point in spacing.between}
            if set(said["between"]) == names and said["mm"] == spacing.given:
                return document.problem((*at, "distances", index, "mm"), spacing.what, cure)
    return Problem("--spacing", 0, 0, spacing.what, cure)


def _problem(
    document: Document, files: dict[str, str], measured: Measurements, error: SetupError, change: Change, others: str
) -> Problem:
    """The change at its place, with what it explains, alone or together with others."""
    what = f"{change.words(lambda row: _line(measured, row))}: {error.evidence}"
    together = [other.words(lambda row: _line(measured, row)) for other in error.changes if other is not change]
    if together:
        what += f", together with: {'; '.join(together[:5])}{' …' if len(together) > 5 else ''}"
    cure = f"{change.cure}{_in(document, files, change)}{others}"
    if change.source == "robot":
        return document.problem(change.key, what, cure)
    line = measured.lines[change.rows[0]] if change.rows else 1
    if change.source == "artefact" and files["artefact"] != files["data"]:
        line = 0
    return Problem(files[change.source], line, 0, what, cure)


def _in(document: Document, files: dict[str, str], change: Change) -> str:
    """Where the cure goes, when it is a key."""
    return f" in {document.file if change.source == 'robot' else files[change.source]}" if change.key else ""


def _others(found: tuple[SetupError, ...], error: SetupError) -> str:
    """What explains as much, in a few words: one of them is true."""
    others = ["; ".join(change.what for change in other.changes) for other in found if other is not error]
    return f"; or else: {'; or: '.join(others)} (these rows cannot tell)"


def _line(measured: Measurements, row: int) -> str:
    return f"line {measured.lines[row]}"
