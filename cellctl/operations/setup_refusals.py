"""Set-up errors as problems in the files that hold them: robot file, data set, artefact."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.calibration.identification.progress import Progress, silent
from cellctl.files import Document, InputError, Problem, load_yaml
from cellctl.formats import Artefact, load_artefact
from cellctl.formats.measurements import Measurements
from cellctl.operations.robot_suggestion import nearer_robots
from cellctl.setup_check import (
    OFF_MM,
    Change,
    ScaleError,
    SetupError,
    SpacingError,
    WideFit,
    check_setup,
    find_spacing_errors,
)


@final
@dataclass(frozen=True, slots=True)
class SetupFiles:
    """The files of a set-up: the robot file, the data set, and the artefact's file where there is one."""

    robot: Document
    data: Path
    artefact: Path | None = None

    def name(self, change: Change) -> str:
        """The file that `change` is to be made in."""
        names = {"robot": self.robot.file, "data": str(self.data), "artefact": str(self.artefact or self.data)}
        return names[change.source]

    def points(self) -> Artefact | None:
        """The artefact; None where the file has none, as a cell file of a campaign without spheres."""
        try:
            return load_artefact(self.artefact) if self.artefact else None
        except InputError:
            return None


def refuse_setup_errors(measured: Measurements, files: SetupFiles, note: str, progress: Progress = silent) -> None:
    """Return where `measured` agrees with the robot file. Else raise InputError with `note`.

    Each set-up error is one Problem at its place, with the evidence ("A3 reversed: RMS 214 → 0.9 mm") and the cure.
    Where the rows do not show which of several is right, all are reported. If no set-up error is found, the certified
    distances are checked; if none explains the misfit, robot file and data may not belong together, or the file may be
    that of another robot of the same family.
    """
    found = check_setup(measured.task, measured.robot.joint_map(), measured.readings, progress)
    if found.left_out:
        progress(f"set-up errors, without {' and '.join(found.left_out)}, which this check cannot judge", 0.9)
    problems = _problems(files, measured, found.errors)
    if found.wide_fit:
        problems = _another_robot(files, measured, found.wide_fit)
    if not problems:
        spacings = find_spacing_errors(measured.task)
        problems = [_spacing(each, files.artefact, _cure(each, several=len(spacings) > 1)) for each in spacings]
    if problems:
        raise InputError(problems, note)


def setup_errors(measured: Measurements, files: SetupFiles, progress: Progress = silent) -> list[Problem]:
    """The set-up errors that explain `measured` by this robot file; none where no error of a set-up does."""
    return _problems(
        files, measured, check_setup(measured.task, measured.robot.joint_map(), measured.readings, progress).errors
    )


def _problems(files: SetupFiles, measured: Measurements, errors: tuple[SetupError, ...]) -> list[Problem]:
    return [
        _problem(files, measured, error, change, _others(errors, error)) for error in errors for change in error.changes
    ]


def _another_robot(files: SetupFiles, measured: Measurements, fit: WideFit) -> list[Problem]:
    """The problem that the rows are of another robot than the file; none where they can be of this one."""
    if not fit.unrelated and not fit.wrong_lengths:
        return []
    nearer = nearer_robots(measured.robot, measured.data, files.points())
    library = f": {nearer.robots[0].name} of the library. {nearer.sentence}" if nearer else ""
    if fit.unrelated:
        return [_unrelated(files, fit, library)]
    return [_wrong_lengths(files, fit, library)] if nearer or fit.impossible else []


def _wrong_lengths(files: SetupFiles, fit: WideFit, library: str) -> Problem:
    """The problem that links have other lengths than the robot file, at the one that is furthest off."""
    lengths = ", ".join(f"{each.parameter.label} {each.deviation_mm:+.3g} mm" for each in fit.wrong_lengths)
    what = (
        f"this is not the robot that was measured: its rows need other lengths, {lengths} (RMS {fit.nominal_mm:.3g} → "
        f"{fit.left_mm:.2g} mm); a robot's lengths are within {fit.tolerance_mm:g} mm (1 σ), and the worst robots are "
        f"{OFF_MM:g} mm off"
    )
    unknown = (
        " (`cellctl robots` lists the library); if its lengths are only roughly known, state so: link_mm in tolerances"
    )
    longest = fit.wrong_lengths[0].parameter
    key = ("links", longest.joint - 1, longest.column) if longest.column else ()
    return files.robot.problem(key, what, f"give the file of the robot that was measured{library or unknown}")


def _unrelated(files: SetupFiles, fit: WideFit, library: str) -> Problem:
    """The problem that robot file and data do not belong together, with figures and possible reasons."""
    what = (
        f"robot file and data do not belong together: RMS {fit.left_mm:.3g} mm after a fit with wide tolerances, where "
        f"robots of this class are {fit.predicted_mm:.2g} mm off before any fit, and measurements shuffled against the "
        f"joints {fit.shuffled_mm:.3g} mm after it"
    )
    cure = f"is {files.robot.file} the robot that was measured? does each row have the joints of its own measurement?"
    cure += f" give the file of that robot{library}" if library else ""
    return Problem(str(files.data), 0, 0, what, cure)


def _cure(contradicted: SpacingError | ScaleError, *, several: bool) -> str:
    """What to look at, and whether another of the named distances may be the wrong one."""
    if isinstance(contradicted, ScaleError):
        return "mm? another unit, or an artefact of another size? correct them or leave them out"
    cure = "mm? the right two points? correct it or leave it out"
    if several and not contradicted.certain:
        cure += " (these rows do not show which of the named distances is wrong)"
    return cure


def _spacing(spacing: SpacingError | ScaleError, artefact: Path | None, cure: str) -> Problem:
    """The distance, or the first of those wrong together, at its place in the artefact's file, or as an option."""
    if artefact is not None:
        document = load_yaml(artefact)
        at: tuple[str, ...] = ("artefact",) if "artefact" in document.data else ()
        for index, distance in enumerate((document.data[at[0]] if at else document.data).get("distances") or []):
            names = {point.partition("@")[0] for point in spacing.between}
            if set(distance["between"]) == names and distance["mm"] == spacing.given:
                return document.problem((*at, "distances", index, "mm"), spacing.what, cure)
    return Problem("--spacing", 0, 0, spacing.what, cure)


def _problem(files: SetupFiles, measured: Measurements, error: SetupError, change: Change, others: str) -> Problem:
    """The change at its place, with its evidence, alone or together with others."""

    def line(row: int) -> str:
        return f"line {measured.lines[row]}"

    what = f"{change.words(line)}: {error.evidence}"
    together = [other.words(line) for other in error.changes if other is not change]
    if together:
        what += f", together with: {'; '.join(together[:5])}{' …' if len(together) > 5 else ''}"
    file = files.name(change)
    cure = f"{change.cure}{f' in {file}' if change.key else ''}{others}"
    if change.source == "robot":
        return files.robot.problem(change.key, what, cure)
    number = measured.lines[change.rows[0]] if change.rows else int(file == str(files.data))
    return Problem(file, number, 0, what, cure)


def _others(found: tuple[SetupError, ...], error: SetupError) -> str:
    """Equally good explanations, in a few words: one of them is right."""
    others = ["; ".join(change.what for change in other.changes) for other in found if other is not error]
    return f"; or else: {'; or: '.join(others)} (these rows do not show which)" if others else ""
