"""What the studies share: arguments, and tables from rows, which `cellctl.operations.studies.runner` computes.

A unit is one seed of one case. Its row is appended to `runs/studies/CODE/NAME.jsonl` when it is finished; a later call
computes only the units whose row is not there. CODE stands for the sources, so that changed code begins anew; each row
has it too.
"""

from __future__ import annotations

import ast
import hashlib
import pkgutil
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from cellctl.operations.studies.runner import Row, as_line, computed, each, in_processes, load, of_unit

__all__ = ["ROWS", "Row", "Study", "Table", "each"]


def code_version(root: Path) -> str:
    """The first digits of a SHA-256 of all that makes a row: the packages, the studies and what they use."""
    digest = hashlib.sha256()
    for folder in ("cellctl", "drivers", "procedures", "sims", "tests/helpers", "tests/studies"):
        for file in sorted((root / folder).rglob("*")):
            if file.suffix in {".py", ".yaml", ".xml", ".csv"}:
                digest.update(f"{file.relative_to(root)} {file.stat().st_size}\n".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


CODE = code_version(Path(__file__).parents[2])
ROWS = Path("runs", "studies", CODE)
"""Rows of all studies by this code, from the folder of the call."""

KEPT = Path(__file__).parent / "kept"
"""Rows that the repository keeps, from which a document's figures are."""


class Table(NamedTuple):
    """Text made from rows. mark: names its place in a document, between `<!-- mark` and `<!-- end of mark -->`."""

    text: str
    mark: str = ""
    title: str = ""


@dataclass(frozen=True)
class Study:
    """What a study's module has as `STUDY`.

    units: what is asked for, each the arguments of `measure`, a function of the module; this gives the other fields of
    the row. tables: of the rows that are there, in the order of the units. seeds, first: how many unless stated, and
    the first one; 0: the study has no seeds. options: more arguments. passed: False ends the call with code 1.
    writes: its tables have a place in a document.
    """

    units: Callable[[Namespace], Iterable[Row]]
    measure: Callable[..., Mapping[str, Any]]
    tables: Callable[[list[Row], Namespace], Iterable[Table]]
    seeds: int = 0
    first: int = 1
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    passed: Callable[[list[Row]], bool] = lambda _: True
    writes: bool = False

    def asked(self, name: str, words: Sequence[str], description: str | None = None) -> Namespace:
        """The arguments of the call; `seeds` is a range."""
        parser = ArgumentParser(f"python -m tests.studies {name}", None, description)
        parser.formatter_class = RawDescriptionHelpFormatter
        if self.seeds:
            parser.add_argument("--seeds", type=int, default=self.seeds, help=f"how many ({self.seeds})")
            parser.add_argument("--first", type=int, default=self.first, help=f"first seed ({self.first})")
        for option, settings in self.options.items():
            parser.add_argument(option, **settings)
        parser.add_argument("--processes", type=int, default=1, help="units at a time")
        parser.add_argument("--kept", action="store_true", help="compute nothing: tables from the rows that are kept")
        if self.writes:
            parser.add_argument("--write", type=Path, metavar="FILE", help="document whose figures are replaced")
        asked = parser.parse_args(words)
        if self.seeds:
            asked.seeds = range(asked.first, asked.first + asked.seeds)
        return asked

    def run(self, name: str, words: Sequence[str], description: str | None = None) -> int:
        """Compute the rows that are not there, print and write the tables; the exit code."""
        asked = self.asked(name, words, description)
        units, file, kept = list(self.units(asked)), ROWS / f"{name}.jsonl", KEPT / f"{name}.jsonl"
        source = kept if asked.kept and kept.exists() else file
        rows = load(source)
        missing = [unit for unit in units if not of_unit(unit, rows)]
        _tell(f"{len(units) - len(missing)} of {len(units)} rows are in {source}")
        if missing and not asked.kept:
            rows += computed(self.measure, missing, file, in_processes(asked.processes), _told, {"code": CODE})
        found = [row for unit in units if (row := of_unit(unit, rows))]
        if not found:
            _tell("no rows, no table")
            return 1
        for table in self.tables(found, asked):
            print(f"## {table.title}\n\n{table.text}\n" if table.title else table.text)
            if self.writes and asked.write:
                write_into(asked.write, table)
        if self.writes and asked.write and kept.exists() and not asked.kept:
            keep(kept, units, found)
        return 0 if self.passed(found) else 1


def _told(unit: Row, done: int, count: int, seconds: float) -> None:
    name = ", ".join(f"{key} {value}" for key, value in unit.items())
    _tell(f"{done} of {count}, {seconds:.0f} s: {name}")


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def keep(file: Path, units: Iterable[Row], rows: Iterable[Row]) -> None:
    """Put rows in place of all that the file has of the same cases, whatever their seeds."""
    cases = [{key: value for key, value in unit.items() if key != "seed"} for unit in units]
    others = [row for row in load(file) if not any(case.items() <= row.items() for case in cases)]
    file.write_text("".join(map(as_line, [*others, *rows])), encoding="utf-8")


def write_into(document: Path, table: Table) -> None:
    """Replace what is between the marks of a table. Raises RuntimeError where the document has none."""
    before, begin, rest = document.read_text(encoding="utf-8").partition(f"<!-- {table.mark}")
    _, end, after = rest.partition(f"<!-- end of {table.mark} -->")
    if not (begin and end):
        marks = f"<!-- {table.mark} --> and <!-- end of {table.mark} -->"
        raise RuntimeError(f"{document} has no place for the figures; add the lines {marks}")
    mark = rest.partition("\n")[0]
    document.write_text(f"{before}{begin}{mark}\n{table.text}\n{end}{after}", encoding="utf-8")


def main(words: Sequence[str]) -> int:
    """The command line: a study by its name, or the list of all."""
    studies = [one.name for one in pkgutil.iter_modules([str(KEPT.parent)]) if not one.name.startswith("_")]
    if not words or words[0] not in studies:
        for name in studies:
            source = Path(find_spec(f"tests.studies.{name}").origin).read_text(encoding="utf-8")
            print(f"{name:22}{ast.get_docstring(ast.parse(source))}".partition("\n")[0])
        return 2 if words and not words[0].startswith("-") else 0
    module = import_module(f"tests.studies.{words[0]}")
    if not hasattr(module, "STUDY"):
        return module.main(words[1:])
    try:
        return module.STUDY.run(words[0], words[1:], module.__doc__)
    except KeyboardInterrupt:
        _tell("interrupted: the same call goes on with the rows that are not there yet")
        return 130
