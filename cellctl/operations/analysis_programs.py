"""A program or a list of targets, compensated with the model of an analysis; the results stay in its folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.calibration.identification.progress import Progress, silent
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import DataSet, ModelFile
from cellctl.formats.dataset import text_of
from cellctl.formats.table_making import row_figures
from cellctl.formats.targets import read_targets
from cellctl.operations.analyses import MODEL, ProgramEntry, TargetsEntry, inside, write_json
from cellctl.operations.compensating import compensate_targets
from cellctl.operations.programs import LeftPlace, ProgramOptions, compensate_files, is_program, program_files
from cellctl.operations.results import as_json
from cellctl.pendant_import import choices, imported_targets


@final
@dataclass(frozen=True)
class ProgramRequest:
    """What to compensate. files: names in the folder `programs/ID/given`. tool, base: X,Y,Z,A,B,C, empty where
    `$config.dat` or the program has them. arm_only, insert: as the options of `cellctl compensate`. orientation: of
    targets in a table with other angles than A, B, C.
    """

    files: tuple[str, ...]
    tool: str = ""
    base: str = ""
    arm_only: bool = False
    insert: bool = False
    orientation: str = ""


def new_program(folder: Path) -> Path:
    """A new folder `programs/ID/given` for the uploaded files. Raises OSError."""
    numbers = [int(each.name) for each in (folder / "programs").glob("[0-9]*")]
    given = folder / "programs" / str(max(numbers, default=0) + 1) / "given"
    given.mkdir(parents=True)
    return given


def compensate_analysis(
    folder: Path, number: str, request: ProgramRequest, progress: Progress = silent
) -> ProgramEntry | TargetsEntry:
    """Compensate the files of `programs/NUMBER`; writes them beside, and `result.json` with name, files and figures.

    Raises InputError where the model, the files or a point do not allow it.
    """
    with inside(folder):
        if not Path(MODEL).is_file():
            raise InputError(Problem(folder.name, 0, 0, "has no model yet", "fit first"))
        model = ModelFile.load(Path(MODEL))
    progress("compensating", 0.1)
    with inside(folder / "programs" / number / "given"):
        out = Path("..")
        config, main = _parts(request)
        if is_program(main):
            result: ProgramEntry | TargetsEntry = _program(number, model, main, config, request, out)
        else:
            result = _targets(number, model, main, request, out)
        write_json(out / "result.json", as_json(result))
    return result


def _parts(request: ProgramRequest) -> tuple[Path | None, Path]:
    """`$config.dat`, and the file with the program or the targets."""
    paths = [Path(name) for name in request.files]
    config = next((path for path in paths if path.name.lower() == "config.dat"), None)
    rest = [path for path in paths if path != config]
    main = [path for path in rest if path.suffix.lower() in (".src", ".script")] or rest
    if len(main) != 1:
        names = ", ".join(path.name for path in paths) or "none"
        cure = "one .src with its .dat and $config.dat, one .script, or one file with targets"
        raise InputError(Problem(names, 0, 0, "is not one program", cure))
    return config, main[0]


def _program(
    number: str, model: ModelFile, src: Path, config: Path | None, request: ProgramRequest, out: Path
) -> ProgramEntry:
    files = program_files(src, config)
    options = ProgramOptions(config, request.tool or None, request.base or None, None, request.insert, request.arm_only)
    made = compensate_files(model, MODEL, files, "pseudo-target", options, None)
    paths = files.outputs(out)
    for part, content in made.texts().items():
        write_atomically(paths[part], content)
    figures = made.figures()
    return ProgramEntry(
        id=number,
        name=src.name,
        kind="program",
        files=tuple(path.name for path in paths.values() if path.is_file()),
        compensated=figures.compensated,
        left=figures.left,
        correction_mm=figures.correction_mm,
        correction_deg=figures.correction_deg,
        before_mm=figures.before_mm,
        after_mm=figures.after_mm,
        tool_shift_mm=figures.tool_shift_mm,
        paths=figures.paths,
    )


def _targets(number: str, model: ModelFile, file: Path, request: ProgramRequest, out: Path) -> TargetsEntry:
    data, left = _target_set(file, request)
    made = compensate_targets(model, read_targets(data, model.robot), data.file)
    name = f"{file.stem}-compensated.csv"
    write_atomically(out / name, made.csv())
    figures = row_figures(made.rows)
    return TargetsEntry(
        id=number,
        name=file.name,
        kind="targets",
        files=(name,),
        compensated=figures["rows"],
        left=left,
        max_correction_deg=figures["max_correction_deg"],
        predicted_before_mm=figures["predicted_before_mm"],
        predicted_after_mm=figures["predicted_after_mm"],
        sigma_mm=figures["sigma_mm"],
    )


def _target_set(file: Path, request: ProgramRequest) -> tuple[DataSet, tuple[LeftPlace, ...]]:
    """The targets as a data set, and what an import left out."""
    if file.suffix.lower() == ".csv" and not request.orientation:
        return DataSet.load(file), ()
    found = imported_targets(file, choices({"orientation": request.orientation or None}))
    left = tuple(LeftPlace(row.file, row.line, row.name, row.reason) for row in found.left_out)
    return DataSet.parse(text_of(found.records), file.name), left
