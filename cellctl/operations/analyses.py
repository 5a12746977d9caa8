"""Analyses: a data file fitted without a cell. Each is a folder `RUNS/analyses/NAME` with its files and results."""

from __future__ import annotations

import json
import re
import time
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias, final

from cellctl.calibration.identification.progress import Progress, part_of, silent
from cellctl.clock import calendar_time
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import RobotFile, load_artefact
from cellctl.installed import near, shipped
from cellctl.journal.journal_file import WriterLock, lock_holder
from cellctl.operations.exporting import ExportOptions, exported, model_source, read_source
from cellctl.operations.fit_options import Asked, Judging
from cellctl.operations.fitting import FitInput, fit_rows
from cellctl.operations.pace import TELLING, continued
from cellctl.operations.programs import LeftPlace, PathFigures
from cellctl.operations.results import ABORTED, MEANINGS, Failure, as_json, from_json
from cellctl.operations.robot_suggestion import Suggestions, doubt_of, suggest_robots
from cellctl.operations.understanding import Candidate, Understood, candidate_of, read_data, understand
from cellctl.pendant_import import choices

Role: TypeAlias = Literal["data", "positions", "robot", "artefact"]

_YAML = (".yaml", ".yml")
URDF_SUFFIX = ".urdf"
_ROBOT = re.compile(r"^(convention|joints|links|screws)\s*:", re.MULTILINE)
_JOINTS = re.compile(r"\b[AJq]_?1\b")
_CURE = "one data file, with it at most: a table of positions, a robot file, an artefact file"

FOLDER = "analyses"
EXAMPLE = Path(__file__).parent / "simulated_kr5_r1400.csv"
"""100 positions of a simulated KR5 R1400, made by `tests/helpers/simulated_data.py`: no real robot is in it."""
EXAMPLE_ROBOT = "kr5_r1400"
RECORD, UNDERSTOOD, OUTCOME, LOG, LOCK = "analysis.json", "understood.json", "outcome.json", "log.jsonl", "lock"
MODEL, REPORT, FIT, URDF = "model.json", "report.html", "fit.json", "robot.urdf"
RESULTS = {MODEL: "model", REPORT: "report", URDF: "URDF", FIT: "figures (JSON)"}
"""Files of a fit that can be downloaded, with what they are."""

_LONGEST_NAME = 80
_CANDIDATES = 3
"""Robots whose set-up check is tried where none of the library agrees; each takes seconds."""

_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"})
_FOLDER = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,199}")
"""Name of an analysis' folder: a safe stem, which may have dots, and the time."""


def roles(heads: Mapping[str, str]) -> dict[Role, str]:
    """The file of each role; heads: the beginning of each file, by its name. Raises InputError for other sets."""
    found: dict[Role, str] = {}
    tables = [name for name in heads if not name.lower().endswith((*_YAML, URDF_SUFFIX))]
    for name in heads.keys() - set(tables):
        role: Role = "robot" if name.lower().endswith(URDF_SUFFIX) or _ROBOT.search(heads[name]) else "artefact"
        if role in found:
            raise InputError(Problem(name, 0, 0, f"there are two {role} files: {found[role]} too", _CURE))
        found[role] = name
    if not tables:
        raise InputError(Problem(", ".join(heads), 0, 0, "there is no data file", _CURE))
    if len(tables) > 2:
        raise InputError(Problem(", ".join(tables), 0, 0, "are more than two data files", _CURE))
    tables.sort(key=lambda name: _JOINTS.search(heads[name]) is None)
    found["data"] = tables[0]
    if len(tables) == 2:
        found["positions"] = tables[1]
    return found


@final
@dataclass(frozen=True)
class FitSettings:
    """Options of a fit, as those of `cellctl fit`: the few that a page offers."""

    model: str = "auto"
    measure: str | None = None
    holdout: float | None = None
    folds: int | None = None
    by: str | None = None
    seed: int = 0
    check: bool = True

    def judging(self) -> Judging:
        """The held-out rows."""
        return Judging(self.holdout, self.folds, None, self.by, self.seed)


@dataclass(frozen=True)
class Analysis:
    """The record of an analysis. data, positions, artefact, robot: names of files in its folder, empty for none.

    dataset: the data set that is fitted: `data`, or what an import made of it. library: the robot's name in the
    library, empty for an own file. answers: to an import's questions, by option (`unit`: `mm`); `repeatability` (mm) of
    a URDF's robot.
    """

    name: str
    created: str
    operator: str
    data: str
    positions: str = ""
    artefact: str = ""
    dataset: str = ""
    robot: str = ""
    library: str = ""
    answers: Mapping[str, str] = field(default_factory=dict)
    settings: FitSettings = field(default_factory=FitSettings)

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Raises InputError where `folder` is no analysis."""
        try:
            given = json.loads((folder / RECORD).read_text(encoding="utf-8"))
            return cls(**{**given, "settings": FitSettings(**given["settings"])})
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise InputError(Problem(folder.name, 0, 0, "is no analysis", "choose one of the list")) from error

    def save(self, folder: Path) -> None:
        """Write the record. Raises OSError."""
        write_json(folder / RECORD, asdict(self))

    def asked(self) -> Asked:
        """The options of the fit, files by their names in the folder."""
        settings, artefact = self.settings, Path(self.artefact) if self.artefact else None
        return Asked(settings.measure, settings.model, artefact, True, (), "base", None, None)


@final
@dataclass(frozen=True)
class Outcome:
    """How a fit ended. code: exit code of `cellctl fit`, and its meaning."""

    state: Literal["done", "failed", "cancelled"]
    code: int
    verdict: str
    sentence: str
    failure: Failure | None
    notes: tuple[str, ...]
    meaning: str

    @classmethod
    def of(cls, verdict: str, sentence: str, notes: tuple[str, ...]) -> Self:
        """Of a fit that was done."""
        code = 0 if verdict == "better" else 1
        return cls("done", code, verdict, sentence, None, notes, MEANINGS[code])

    @classmethod
    def without_a_fit(cls, state: Literal["failed", "cancelled"], code: int, failure: Failure | None = None) -> Self:
        """Of a fit that failed or was cancelled."""
        return cls(state, code, "", "", failure, (), MEANINGS[code])


@dataclass(frozen=True)
class _Entry:
    id: str
    name: str
    kind: Literal["program", "targets"]
    files: tuple[str, ...]
    compensated: int
    left: tuple[LeftPlace, ...]


@final
@dataclass(frozen=True)
class ProgramEntry(_Entry):
    """A program that was compensated with the model of an analysis: see `ProgramFigures`. files: written ones."""

    kind: Literal["program"]
    correction_mm: dict[str, float]
    correction_deg: dict[str, float]
    before_mm: dict[str, float]
    after_mm: dict[str, float]
    tool_shift_mm: float | None
    paths: tuple[PathFigures, ...]

    @property
    def predicted(self) -> tuple[dict[str, float], dict[str, float]]:
        """Predicted errors before and after, mm."""
        return self.before_mm, self.after_mm


@final
@dataclass(frozen=True)
class TargetsEntry(_Entry):
    """A list of targets that was compensated: see `row_figures`. files: written ones."""

    kind: Literal["targets"]
    max_correction_deg: float
    predicted_before_mm: dict[str, float]
    predicted_after_mm: dict[str, float]
    sigma_mm: dict[str, float] | None

    @property
    def predicted(self) -> tuple[dict[str, float], dict[str, float]]:
        """Predicted errors before and after, mm."""
        return self.predicted_before_mm, self.predicted_after_mm


@final
@dataclass(frozen=True)
class AnalysisState(Analysis):
    """The record of an analysis, its state, how its fit ended, and the files that can be downloaded.

    process: that fits now. programs: see `programs`.
    """

    state: Literal["new", "running", "done", "failed", "cancelled", "cut off"] = "new"
    process: int | None = None
    outcome: Outcome | None = None
    files: Sequence[str] = ()
    programs: tuple[ProgramEntry | TargetsEntry, ...] = ()


@final
@dataclass(frozen=True)
class Understanding:
    """What the data of an analysis are understood as. doubt: why they are hardly of the robot, empty without one.

    candidate: without a robot that agrees, one of the library that does once a set-up error is corrected.
    """

    data: Understood
    doubt: str
    suggestions: Suggestions | None
    candidate: Candidate | None = None


def safe_name(name: str, default: str = "file") -> str:
    """A file name without folder, hidden name, or characters other than letters, digits, `.`, `-` and `_`.

    Umlauts become two letters, letters with accents lose them. default: stem of a name without any such character.
    """
    spelt = unicodedata.normalize("NFC", re.split(r"[/\\]", name)[-1]).translate(_UMLAUTS)
    letters = "".join(each for each in unicodedata.normalize("NFKD", spelt) if not unicodedata.combining(each))
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", letters).rstrip(".")
    stem, dot, suffix = plain.rpartition(".")
    stem, suffix = (stem, suffix[:12]) if dot else (suffix, "")
    stem = stem.lstrip("._-") or default
    return f"{stem[: _LONGEST_NAME - len(suffix)]}{dot}{suffix}"


def free_name(folder: Path, name: str, role: str) -> str:
    """A safe name for the uploaded file `name` that no other file of the analysis has."""
    safe = safe_name(name, role)
    taken = (RECORD, UNDERSTOOD, OUTCOME, LOG, LOCK, *RESULTS)
    return f"{role}-{safe}" if safe in taken or (folder / safe).exists() else safe


def new_analysis(runs: Path, operator: str, data: str) -> tuple[Path, Analysis]:
    """A new folder for the data file named `data`, which is still to be put there. Raises OSError."""
    file = free_name(runs / FOLDER, data, "data")
    created = calendar_time()
    name = f"{Path(file).stem}-{re.sub('[-:]', '', created)}"
    folders = (runs / FOLDER / (f"{name}-{number}" if number > 1 else name) for number in range(1, 1000))
    folder = next(each for each in folders if _made(each))
    found = Analysis(folder.name, created, operator, file)
    found.save(folder)
    return folder, found


def analysis_folder(runs: Path, name: str) -> Path:
    """The folder of the analysis `name`. Raises InputError where there is none."""
    folder = runs / FOLDER / name
    if not _FOLDER.fullmatch(name) or not (folder / RECORD).is_file():
        raise InputError(Problem(name, 0, 0, "there is no such analysis", "choose one of the list"))
    return folder


def analyses(runs: Path) -> list[AnalysisState]:
    """All analyses, the newest first."""
    records = (runs / FOLDER).glob(f"*/{RECORD}")
    found = [state_of(record.parent) for record in records]
    return sorted(found, key=lambda each: (each.created, each.name), reverse=True)


def state_of(folder: Path) -> AnalysisState:
    """The state of an analysis. Raises InputError."""
    record, content = Analysis.load(folder), read_json(folder / OUTCOME)
    outcome = from_json(Outcome, content) if content else None
    running = lock_holder(folder / LOCK)
    begun = (folder / LOG).exists()
    return AnalysisState(
        **vars(record),
        state="running" if running else outcome.state if outcome else "cut off" if begun else "new",
        process=int(running.pid) if running else None,
        outcome=outcome if not running else None,
        files=[name for name in RESULTS if (folder / name).is_file()] if not running else [],
        programs=programs(folder),
    )


def understanding(folder: Path) -> Understanding | None:
    """What the data of an analysis are understood as; None where they have not been read."""
    content = read_json(folder / UNDERSTOOD)
    if not content:
        return None
    suggestions = content.get("suggestions")
    return Understanding(
        from_json(Understood, content),
        content.get("doubt", ""),
        from_json(Suggestions, suggestions) if suggestions else None,
        from_json(Candidate, content["candidate"]) if content.get("candidate") else None,
    )


def set_robot(folder: Path, library_name: str = "", file: str = "") -> Analysis:
    """Choose the robot: one of the library, or a robot file that is in the folder. Raises InputError."""
    record = Analysis.load(folder)
    if library_name:
        known = shipped("robot")
        if library_name not in known:
            raise InputError(Problem(library_name, 0, 0, "the library has no robot of this name", near(library_name)))
        file = f"{library_name}.yaml"
        write_atomically(folder / file, known[library_name].read_bytes())
    changed = replace(record, robot=file, library=library_name)
    changed.save(folder)
    return changed


def understand_analysis(folder: Path, progress: Progress = silent) -> dict[str, Any]:
    """Read the data, suggest a robot, and look for set-up errors; writes the data set and `understood.json`. A URDF is
    converted to a robot file.

    Without a chosen robot, the best suggestion is taken, if one agrees with the rows. Raises InputError where the file
    cannot be read.
    """
    with inside(folder):
        record = _with_robot_file(Analysis.load(Path()))
        robot = Path(record.robot) if record.robot else None
        progress("reading the data", 0.0)
        given = read_data(Path(record.data), _path(record.positions), _choices(record), robot)
        if given.data.file != record.data:
            given.data.write(Path(given.data.file))
        record = replace(record, dataset=given.data.file)
        record.save(Path())
        progress("comparing with the library", 0.2)
        artefact = load_artefact(Path(record.artefact)) if record.artefact else None
        suggestions = (read_json(Path(UNDERSTOOD)) or {}).get("suggestions")
        if not suggestions:
            suggestions = as_json(suggest_robots(given.data, artefact))
        if not record.robot and suggestions["certainty"] != "none":
            record = set_robot(Path(), suggestions["robots"][0]["name"])
        progress("set-up check", 0.6)
        found = understand(given, _path(record.robot), record.asked(), progress)
        doubt = ""
        if record.robot and not found.problems:
            doubt = doubt_of(RobotFile.load(Path(record.robot)), given.data, artefact)
        candidate = None
        if not record.robot and not found.problems:
            best = [each["name"] for each in suggestions["robots"][:_CANDIDATES]]
            candidate = candidate_of(given, {name: shipped("robot")[name] for name in best}, record.asked(), progress)
        result = {
            **as_json(found),
            "doubt": doubt,
            "suggestions": suggestions,
            "candidate": as_json(candidate) if candidate else None,
        }
        write_json(Path(UNDERSTOOD), result)
    return result


def fit_analysis(folder: Path, settings: FitSettings, progress: Progress = silent) -> Outcome:
    """Fit the robot of an analysis as `cellctl fit` does; writes model, report, figures, URDF and the outcome.

    Errors are written as the outcome, and raised. Raises JournalError while another process fits it.
    """
    lock = WriterLock.take(folder / LOCK)
    try:
        for name in (OUTCOME, LOG, *RESULTS):
            (folder / name).unlink(missing_ok=True)
        replace(Analysis.load(folder), settings=settings).save(folder)
        with inside(folder), _kept_on_error():
            outcome = _fitted(_logged(Path(LOG), progress))
            write_json(Path(OUTCOME), as_json(outcome))
    finally:
        lock.release()
    return outcome


def programs(folder: Path) -> tuple[ProgramEntry | TargetsEntry, ...]:
    """The compensated programs of an analysis, and targets."""
    results = sorted(folder.glob("programs/*/result.json"), key=lambda path: int(path.parent.name))
    found = [content for path in results if (content := read_json(path))]
    return tuple(
        from_json(ProgramEntry, each) if each["kind"] == "program" else from_json(TargetsEntry, each) for each in found
    )


def read_json(path: Path) -> dict[str, Any] | None:
    """The object in a file; None where there is none, or only a part of one."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Write `value` as JSON. Raises OSError."""
    write_atomically(path, json.dumps(value, indent=1, ensure_ascii=False) + "\n")


@contextmanager
def inside(folder: Path) -> Iterator[None]:
    """Work in `folder`, so that errors name its files as the user does. Only in a process of its own."""
    with chdir(folder):
        yield


@contextmanager
def _kept_on_error() -> Iterator[None]:
    """Write an error as the outcome."""
    try:
        yield
    except KeyboardInterrupt:
        write_json(Path(OUTCOME), as_json(Outcome.without_a_fit("cancelled", ABORTED)))
        raise
    except Exception as error:
        failure = Failure.of(error)
        write_json(Path(OUTCOME), as_json(Outcome.without_a_fit("failed", failure.code, failure)))
        raise


def _fitted(progress: Progress) -> Outcome:
    record = Analysis.load(Path())
    asked, judging = record.asked(), record.settings.judging()
    asked.refuse(judging)
    if not record.robot:
        raise InputError(Problem(record.data, 0, 0, "no robot is chosen", "choose one, or give a robot file"))
    given = FitInput.load(Path(record.robot), Path(record.dataset or record.data), asked)
    began = time.monotonic()

    def shown(name: str) -> nullcontext[Progress]:
        if name == "check":
            return nullcontext(part_of(progress, 0.0, TELLING))  # how long the fit takes is not known yet
        return nullcontext(continued(part_of(progress, 0.0, 0.97), time.monotonic() - began, time.monotonic))

    found = fit_rows(given, asked, judging, shown, check=record.settings.check)
    progress("writing model and report", 0.98)
    model = found.model()
    model.save(Path(MODEL))
    uploaded = f"{record.created} by {record.operator}"
    write_atomically(Path(REPORT), found.page(record.library or record.robot, record.data, uploaded))
    write_json(Path(FIT), found.report)
    return Outcome.of(found.report["verdict"], found.report["sentence"], _urdf(model))


def _urdf(model: Any) -> tuple[str, ...]:
    """Write the URDF; what it cannot hold, or why there is none."""
    try:
        made = exported(model_source(model, MODEL), "urdf", ExportOptions())
    except InputError as error:
        return tuple(f"URDF: {problem.what}" for problem in error.problems)
    write_atomically(Path(URDF), made.content)
    return tuple(f"URDF: {line}" for line in made.lines())


def _logged(log: Path, progress: Progress) -> Progress:
    """Also write each new activity to `log`."""
    log.touch()
    last = ""

    def told(doing: str, share: float) -> None:
        nonlocal last
        progress(doing, share)
        if doing != last:
            last = doing
            with log.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps({"time": calendar_time(), "doing": doing, "share": round(share, 3)}) + "\n")

    return told


def _with_robot_file(record: Analysis) -> Analysis:
    """The record, with a robot file in place of a URDF. Raises InputError."""
    if not record.robot.lower().endswith(URDF_SUFFIX):
        return record

    source = read_source(Path(record.robot), None, None, _repeatability(record))
    content = exported(source, "mdh-hayati", ExportOptions()).content
    file = free_name(Path(), f"{Path(record.robot).stem}.yaml", "robot")
    write_atomically(Path(file), content)
    return replace(record, robot=file)


def _repeatability(record: Analysis) -> float | None:
    """The stated repeatability of a URDF's robot, mm; None without a statement. Raises InputError."""
    given = record.answers.get("repeatability")
    if not given:
        return None
    try:
        value = float(given.replace(",", "."))
    except ValueError:
        value = 0.0
    if not 0.0 < value < 10.0:
        what = f"'{given[:40]}' is no repeatability"
        raise InputError(Problem(record.robot, 0, 0, what, "--repeatability in mm, above 0 and below 10"))
    return value


def _choices(record: Analysis) -> Any:
    answers = dict(record.answers)
    columns = answers.pop("columns", "")
    return choices(
        {name: answers.get(name) for name in ("decimal", "unit", "angles", "pair", "orientation", "j3")}, [columns]
    )


def _path(name: str) -> Path | None:
    return Path(name) if name else None


def _made(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        return False
    return True
