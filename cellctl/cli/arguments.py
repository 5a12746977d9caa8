"""What several verbs share: arguments and options, output files checked before the work, output to stdout."""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, final

import typer

from cellctl.files import InputError, Problem, is_stream, write_atomically
from cellctl.installed import shipped_file


def _procedure(given: Path) -> Path:
    return shipped_file("procedure", given)


def _procedure_or_none(given: Path | None) -> Path | None:
    return _procedure(given) if given else None


def cell_or_none(given: Path | None) -> Path | None:
    """The cell file of that name, or the shipped one; None where none is given."""
    return shipped_file("cell", given) if given else None


def _robot(given: Path | None) -> Path | None:
    return shipped_file("robot", given) if given else None


VARIABLE = "CELLCTL_INDEX"
"""The URL of the index, for this process and those that it starts (`cellctl.run_index`)."""


def _use_index(given: str | None) -> str | None:
    if given:
        os.environ[VARIABLE] = given
    return given


Procedure = Annotated[Path, typer.Argument(help="Procedure file or shipped name.", callback=_procedure)]
AnyProcedure = Annotated[
    Path | None, typer.Argument(help="Procedure file or shipped name.", callback=_procedure_or_none)
]
Cell = Annotated[Path, typer.Argument(help="Cell file or shipped name.", callback=cell_or_none)]
CellOption = Annotated[Path, typer.Option("--cell", help="Cell file or shipped name.", callback=cell_or_none)]
OtherCell = Annotated[
    Path | None,
    typer.Option("--cell", help="Cell file or shipped name. Default: the procedure's cell.", callback=cell_or_none),
]
ShownCell = Annotated[
    Path | None,
    typer.Option("--cell", help="Cell file or shipped name: show its controller's tables.", callback=cell_or_none),
]
ComparedCell = Annotated[
    Path | None,
    typer.Option("--cell", help="Cell file or shipped name: ask its controller too.", callback=cell_or_none),
]
ViewedCell = Annotated[
    Path | None, typer.Option("--cell", help="Cell file or shipped name: the cell to show.", callback=cell_or_none)
]
CheckedCell = Annotated[
    Path | None,
    typer.Option(
        "--cell", help="Cell file or shipped name: checks robot, tool, largest correction.", callback=cell_or_none
    ),
]
Robot = Annotated[
    Path, typer.Argument(help="Robot file (link table, joints, base, tool), or a shipped name.", callback=_robot)
]
FittedRobot = Annotated[Path, typer.Argument(help="Robot file, URDF (.urdf), or a shipped name.", callback=_robot)]
RobotOption = Annotated[
    Path | None,
    typer.Option("--robot", help="Robot file or shipped name: checks number and limits of joints.", callback=_robot),
]
TcpRobot = Annotated[
    Path | None,
    typer.Option("--robot", help="Robot file or shipped name: also show changes of the TCP, mm.", callback=_robot),
]
SheetRobot = Annotated[
    Path | None,
    typer.Option("--robot", help="Of a maker's calibration: robot file or shipped name of its robot.", callback=_robot),
]
AnyRobot = Annotated[
    Path,
    typer.Argument(
        help="Robot file (.yaml), model (.json), .urdf, DH table (.csv), maker's calibration, UR's cell, shipped name.",
        callback=_robot,
    ),
]
Settings = Annotated[list[str] | None, typer.Option("--set", help="A parameter, name=value; may be repeated.")]
Run = Annotated[Path, typer.Argument(help="Run folder or name.")]
Runs = Annotated[Path, typer.Option("--runs", help="Folder that holds the runs.")]
Index = Annotated[
    str | None,
    typer.Option(
        "--index",
        envvar=VARIABLE,
        help="Database of the index: postgresql://user@host/database, for several hosts. Default: RUNS/index.sqlite.",
        callback=_use_index,
    ),
]
Json = Annotated[str | None, typer.Option("--json", help="Write the result as JSON to this file; - for stdout.")]
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Output file. Default: stdout.")]
Seed = Annotated[int | None, typer.Option(help="Seed of the simulated robot's errors.", min=0)]


def shown_name(path: Path) -> str:
    """A file's name as text, for any bytes in it."""
    return os.fsencode(path.name).decode(errors="replace")


def refuse_outputs(outputs: Mapping[str, Path | str | None], inputs: Collection[Path | None]) -> None:
    """Raise InputError if an output (by its option; None: no output) cannot be a file, is one of the `inputs`, or is
    given twice. `-` is stdout for the JSON, and an error for other outputs.
    """
    wanted = {option: Path(path) for option, path in outputs.items() if path is not None}
    if str(wanted.get("--json")) == "-":
        del wanted["--json"]
    read = {os.path.realpath(path) for path in inputs if path is not None}
    problems, taken = [], dict[str, str]()
    for option, path in wanted.items():
        if (what := _why_not(path, read, taken)) is not None:
            problems.append(Problem(str(path), 0, 0, what, f"give {option} another file"))
        taken.setdefault(os.path.realpath(path), option)
    if problems:
        raise InputError(problems)


def refuse_json_on_stdout(json_: str | None, out: Path | None, what: str) -> None:
    """Raise InputError if both the JSON and `what`, the verb's own output, would go to stdout."""
    if json_ == "-" and out is None:
        raise InputError(Problem("--json", 0, 0, f"{what} itself goes to stdout", "give -o FILE too"))


@final
class Unwritten:
    """Outputs that could not be written (full disk): reported after the other outputs and the result."""

    def __init__(self) -> None:
        self._problems: list[Problem] = []

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Writes one output; an OSError is kept for later."""
        try:
            yield
        except OSError as error:
            what = f"could not be written: {error.strerror or error}"
            self._problems.append(Problem(str(error.filename), 0, 0, what, "free some space, or choose another folder"))

    def refuse(self) -> None:
        """Raise InputError with every one of them."""
        if self._problems:
            raise InputError(self._problems)


def to_stdout(content: str | bytes) -> None:
    """Write a file's content to stdout, text in UTF-8 as in files, for any terminal encoding."""
    typer.echo(content.encode() if isinstance(content, str) else content, nl=False)


def write_json(result: dict[str, Any], target: str | None) -> None:
    """Write `result` to a file, or to stdout for `-`."""
    if target is None:
        return
    text = json.dumps(result, indent=2, ensure_ascii=False) + "\n"
    if target == "-":
        to_stdout(text)
    else:
        write_atomically(Path(target), text)


@contextmanager
def refused_rows(target: str | None) -> Iterator[None]:
    """Write what is refused inside this context as JSON too: on the terminal only the first of many are shown."""
    try:
        yield
    except InputError as error:
        rows = [{"file": p.file, "line": p.line, "reason": p.what, "cure": p.cure} for p in error.problems]
        write_json({"refused": rows, "note": error.note}, target)
        raise


def _why_not(path: Path, read: Collection[str], taken: Mapping[str, str]) -> str | None:
    real = os.path.realpath(path)
    if str(path) == "-":
        return "is stdout for --json alone"
    if path.is_dir():
        return "is a folder"
    if not path.parent.is_dir():
        return "lies in a folder that is not there"
    if is_stream(path):
        return None  # a stream can be written several times
    if real in read:
        return "is read here: it would be written over"
    if real in taken:
        return f"is written by {taken[real]} as well"
    return None if _may_be_written(path) else "may not be written"


def _may_be_written(path: Path) -> bool:
    """Whether the file may be replaced by a new one; this also needs write permission for the folder."""
    folder = Path(os.path.realpath(path)).parent
    return os.access(folder, os.W_OK | os.X_OK) and (not path.exists() or os.access(path, os.W_OK))


def in_minutes(seconds: float) -> str:
    """A time in words: `3 min 05 s`, `12 s`."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
