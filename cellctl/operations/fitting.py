"""A fit from its input to model and report, with its held-out rows: shared by `cellctl fit` and `cellctl.fit`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, TypeAlias, final

import numpy as np
from threadpoolctl import threadpool_limits

from cellctl.calibration import FitResult, Split, fit
from cellctl.calibration.identification.progress import Progress, silent
from cellctl.calibration.verdict.comparison import ComparedFits
from cellctl.files import Document, InputError, Problem, load_yaml, parse_yaml, sha256_of
from cellctl.files.kinds import ROBOT
from cellctl.formats import (
    Artefact,
    DataSet,
    Measurements,
    ModelFile,
    RobotFile,
    fit_report,
    from_prior,
    load_artefact,
    measurements,
    only,
)
from cellctl.formats.description import robot_text
from cellctl.formats.measurements import refuse_alike
from cellctl.formats.type_prior import USED, TypePriorFile, with_type_prior
from cellctl.formats.urdf import load_urdf
from cellctl.operations.fit_options import Asked, Judging, option
from cellctl.operations.fold_processes import FoldProcesses
from cellctl.operations.results import as_json, from_json
from cellctl.operations.setup_refusals import SetupFiles, refuse_setup_errors
from cellctl.report.fit import FitStory

Shown: TypeAlias = Callable[[str], AbstractContextManager[Progress]]
"""Makes the progress report of a part of the work, by its name."""

DEFAULT_FOLDS = 5
MOST_LABELS = 100
"""A column with more values than this is a number, not a label."""


def split_of(measured: Measurements, judging: Judging) -> tuple[Split, list[str]]:
    """The split, and with `--by` the label of each held-out row. Raises InputError if there is no such split."""
    split = _enough(measured, _split(measured, judging))
    if judging.by is None:
        return split, []
    labels = measured.texts(judging.by)
    return split, [labels[row] for _, test in split.judged for row in test]


def _split(measured: Measurements, judging: Judging) -> Split:
    rows, postures = len(measured.lines), measured.postures()
    if judging.by is not None:
        return Split.leaving_out(_labels(measured, judging.by))
    if judging.holdout is not None:
        return Split.holdout(rows, judging.holdout, judging.seed, postures)
    if judging.folds is None and (judging.column or any(measured.sets)):
        if not any(measured.sets):
            cure = "add it, with fit or test in each row"
            raise InputError(option("column", "the data set has no column set", cure))
        return Split.by_column(np.array([name == "test" for name in measured.sets]))
    if judging.folds is not None and judging.folds > rows:
        what = f"{judging.folds} folds, but the data set has {rows} usable rows"
        raise InputError(option("folds", what, f"{rows} or fewer"))
    return Split.folds(rows, min(judging.folds or DEFAULT_FOLDS, len(set(postures))), judging.seed, postures)


def _labels(measured: Measurements, column: str) -> list[str]:
    if not measured.data.has(column):
        cure = f"columns here: {', '.join(measured.data.columns[:12])}"
        raise InputError(option("by", f"the data set has no column '{column}'", cure))
    labels = measured.texts(column)
    count = len(set(labels))
    if not all(labels):
        line = measured.lines[labels.index("")]
        raise InputError(
            option("by", f"column '{column}' is empty in line {line}", "fill it in, or leave that row out")
        )
    if count < 2:
        what = f"column '{column}' has one value, '{labels[0]}': nothing would be left to fit"
        raise InputError(option("by", what, "a column with two values or more"))
    if count > MOST_LABELS or count == len(labels):
        what = f"column '{column}' has {count} values in {len(labels)} rows: it is a number, not a label"
        raise InputError(option("by", what, f"a column with at most {MOST_LABELS} values, several rows for each"))
    return labels


def _enough(measured: Measurements, split: Split) -> Split:
    """`split`, unless a part of it has fewer different rows than registration alone has unknowns."""
    least, seen = measured.task.rows_at_least, np.array(measured.sightings())
    parts = [split.fit, *(part for part, _ in split.judged)]
    fewest, rows = min((len(np.unique(seen[part])), len(part)) for part in parts)
    if fewest >= least:
        return split
    repeated = f" in {fewest} postures" if fewest < rows else ""
    what = f"{rows} rows to fit{repeated} where even the registration takes {least}"
    raise InputError(Problem("the data set", 0, 0, what, "measure more, or hold out less"))


NO_CHECK = "--no-check skips this check and fits anyway: do not use such a model before you know the cause"


@final
@dataclass(frozen=True, eq=False)
class FitInput:
    """The input of a fit, read. document: the robot file with its positions."""

    document: Document
    robot: RobotFile
    data: DataSet
    artefact: Artefact | None = None
    prior: ModelFile | None = None
    type_prior: TypePriorFile | None = None

    @property
    def sources(self) -> dict[str, str]:
        """Names of the robot file and the data set, for a page."""
        return {"robot file": Path(self.document.file).name, "data set": Path(self.data.file).name}

    @classmethod
    def read(
        cls,
        robot: Callable[[], tuple[Document, RobotFile]],
        data: Callable[[], DataSet],
        artefact: Callable[[], Artefact | None],
        prior: Callable[[], ModelFile | None],
        type_prior: Path | None = None,
    ) -> Self:
        """Read all parts. Raises InputError with the errors of all of them at once."""
        loaders = [robot, data, artefact, prior, lambda: TypePriorFile.load(type_prior) if type_prior else None]
        (document, robot_file), rows, points, older, of_type = _all_of(loaders)
        return cls(document, robot_file, rows, points, older, of_type)

    @classmethod
    def load(
        cls, robot: Path, data: Path, asked: Asked, *, tip: str | None = None, repeatability: float | None = None
    ) -> Self:
        """Read the files of a fit. Raises InputError with all their errors; swapped files are recognised.

        tip, repeatability: of a robot given as URDF, see `robot_of`.
        """
        artefact, prior = asked.artefact, asked.prior
        try:
            return cls.read(
                lambda: robot_of(robot, tip, repeatability),
                lambda: DataSet.load(data),
                lambda: load_artefact(artefact) if artefact else None,
                lambda: ModelFile.load(prior) if prior else None,
                asked.prior_of_type,
            )
        except InputError as error:
            if _is_robot(data):
                what = f"is taken for the robot file, and the data set {data} is a robot file: they are swapped"
                cure = f"cellctl fit {data} {robot}"
                raise InputError(Problem(str(robot), 0, 0, what, cure)) from error
            raise

    @property
    def hashes(self) -> dict[str, str]:
        """SHA-256 of the parts, for the model's provenance."""
        found = {"data_sha256": self.data.sha256}
        if self.artefact:
            found["artefact_sha256"] = sha256_of(self.artefact.model_dump())
        if self.prior:
            found["prior_sha256"] = sha256_of(self.prior.text())
        if self.type_prior:
            found[USED] = sha256_of(self.type_prior.text())
        return found


@final
@dataclass(frozen=True, eq=False)
class Fitted:
    """A fit: its usable rows, their split, the result, and the report, which is the JSON of `cellctl fit` without
    `seconds`.
    """

    given: FitInput
    measured: Measurements
    split: Split
    result: FitResult
    report: dict[str, Any]

    def model(self) -> ModelFile:
        """The model file."""
        given = self.given
        return ModelFile.of(self.measured.robot, self.measured, self.result, given.hashes, given.prior)

    def page(self, robot: str, data: str, uploaded: str = "") -> str:
        """The report as an HTML page; `robot`, `data`: names of these files on it; uploaded: when and by whom."""
        from cellctl.report.fit.page import fit_page  # here: matplotlib takes a second, and few fits draw a page

        sources = {"robot file": robot, "data set": f"{data}, SHA-256 {self.given.data.sha256[:12]}…"}
        sources |= {"uploaded": uploaded} if uploaded else {}
        return fit_page(FitStory.of(self.measured, self.result, self.split, self.report, sources))


def fit_rows(
    given: FitInput,
    asked: Asked,
    judging: Judging,
    shown: Shown | None = None,
    *,
    check: bool,
    processes: int | None = None,
) -> Fitted:
    """Fit the robot to the data set, and judge it on held-out rows.

    check: look for set-up errors first. shown: makes the progress report of `check` and of `fit`. processes: most that
    compute the folds; None: as many as processors, for a fit that takes long. The options are checked before
    (`Asked.refuse`). Raises InputError where data, options and files do not allow a fit.
    """
    measured = measured_rows(given, asked)
    refuse_alike(measured)
    split, labels = split_of(measured, judging)
    progress = shown or silently
    if check and not asked.free_groups:  # free parameters may deviate as much as an error would
        files = SetupFiles(given.document, Path(given.data.file), asked.artefact)
        with progress("check") as told:
            refuse_setup_errors(measured, files, NO_CHECK, told)
    with progress("fit") as told:
        result = fit_with_processes(given, asked, judging, measured, split, told, processes)
    return Fitted(given, measured, split, result, fit_report(measured, result, labels))


def fit_with_processes(
    given: FitInput,
    asked: Asked,
    judging: Judging,
    measured: Measurements,
    split: Split,
    told: Progress,
    processes: int | None,
) -> FitResult:
    """`fit`, its folds in up to so many processes; one thread for linear algebra in each, so that the number of
    processes changes no bit.
    """
    folds = FoldProcesses(measured.task, split, fit_request(given, asked, judging), processes, told)
    with threadpool_limits(1, user_api="blas"):
        return fit(measured.task, split, folds.model, folds)


def fit_request(given: FitInput, asked: Asked, judging: Judging) -> dict[str, Any]:
    """From which `requested_rows` makes rows and split of a fit in another process: JSON."""
    data = given.data
    return {
        "robot": given.robot.model_dump(mode="json"),
        "data": {"file": data.file, "columns": data.columns, "cells": data.cells, "lines": data.lines},
        "artefact": given.artefact.model_dump(mode="json") if given.artefact else None,
        "prior": given.prior.model_dump(mode="json") if given.prior else None,
        "asked": as_json(asked),
        "judging": as_json(judging),
    }


def requested_rows(request: Mapping[str, Any]) -> tuple[Measurements, Split]:
    """Rows and split of a `fit_request`."""
    data = request["data"]
    given = FitInput(
        document=Document(data["file"], "", request["robot"], {(): (0, 0)}, {}),
        robot=RobotFile.model_validate(request["robot"]),
        data=DataSet(data["file"], tuple(data["columns"]), tuple(map(tuple, data["cells"])), tuple(data["lines"])),
        artefact=Artefact.model_validate(request["artefact"]) if request["artefact"] else None,
        prior=ModelFile.model_validate(request["prior"]) if request["prior"] else None,
    )
    measured = measured_rows(given, from_json(Asked, request["asked"]))
    return measured, split_of(measured, from_json(Judging, request["judging"]))[0]


def robot_of(path: Path, tip: str | None = None, repeatability: float | None = None) -> tuple[Document, RobotFile]:
    """The robot file, read once: it may change while the fit runs, or be a pipe. A URDF is read as `poe`.

    tip: the URDF's last link, where its links branch; repeatability: 1 σ, mm, which a URDF does not state. Raises
    InputError, also where one of them is given beside a robot file.
    """
    if path.suffix.lower() == ".urdf":
        described = replace(load_urdf(path, tip), repeatability=repeatability)
        document = parse_yaml(robot_text(described, "poe", str(path)), f"{path} as poe")
        return document, RobotFile.from_document(document)
    given = {"--tip": tip, "--repeatability": repeatability}
    if beside := [name for name, value in given.items() if value is not None]:
        cure = f"leave it out, or change it in {path}"
        raise InputError(Problem(name, 0, 0, "is for a robot given as URDF", cure) for name in beside)
    document = load_yaml(path, ROBOT)
    return document, RobotFile.from_document(document)


def silently(_: str) -> AbstractContextManager[Progress]:
    """No progress report."""
    return nullcontext(silent)


def _is_robot(path: Path) -> bool:
    """Whether a file contains a robot, even with errors."""
    try:
        content = load_yaml(path).data
    except InputError:
        return False
    return isinstance(content, dict) and {"convention", "joints"} <= content.keys()


def measured_rows(given: FitInput, asked: Asked) -> Measurements:
    """The usable rows for the fit. Raises InputError where data and options do not allow one."""
    measured = measurements(
        given.robot,
        given.data,
        measure=asked.measure,
        model=asked.model,
        artefact=given.artefact,
        use_distances=asked.distances,
        spacings=asked.spacings,
        own=asked.own_groups,
    )
    if given.prior:
        return from_prior(measured, given.prior, asked.free_groups, str(asked.prior))
    if given.type_prior:
        return with_type_prior(measured, given.type_prior, str(asked.prior_of_type))
    return only(measured, asked.free_groups) if asked.free_groups else measured


def _all_of(loaders: list[Callable[[], Any]]) -> list[Any]:
    loaded, problems = [], []
    for load in loaders:
        try:
            loaded.append(load())
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return loaded


FIRST = "auto"
"""The first of every comparison; the others are compared with it."""

USUAL = ("geometry", "kriging", "geometry+kriging", "geometry+idw")
"""In place of `usual`: they need no column and no library that may be missing."""


def compare_fits(
    given: FitInput,
    asked: Asked,
    judging: Judging,
    choices: Sequence[str],
    shown: Shown | None = None,
    *,
    check: bool,
    processes: int | None = None,
) -> ComparedFits:
    """`auto` and each of `choices`, on the same rows and folds. Raises InputError where one cannot be fitted.

    processes: as for `fit_rows`.
    """
    names = tuple(dict.fromkeys([FIRST, *(each for one in choices for each in (USUAL if one == "usual" else (one,)))]))
    progress, first, results, seconds = shown or silently, None, [], []
    for name in names:
        began = time.perf_counter()
        of_this = replace(asked, model=name)
        measured = measured_rows(given, of_this)
        if first is None:
            refuse_alike(measured)
            first, (split, _) = measured, split_of(measured, judging)
            if not split.judged:
                raise InputError(option("compare", "no row is held out", "--folds 5, --holdout 0.3 or --column set"))
            if check:
                files = SetupFiles(given.document, Path(given.data.file), asked.artefact)
                with progress("check") as told:
                    refuse_setup_errors(measured, files, NO_CHECK, told)
        with progress(name) as told:
            try:
                results.append(fit_with_processes(given, of_this, judging, measured, split, told, processes))
            except ValueError as error:
                raise InputError(option("compare", f"{name}: {error}", "leave this model out")) from error
        seconds.append(time.perf_counter() - began)
    assert first is not None
    return ComparedFits.of(names, results, seconds, split, first.noun)
