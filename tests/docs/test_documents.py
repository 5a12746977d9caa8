"""What the documents show works: commands run, programs run, files are read, links lead somewhere."""

from __future__ import annotations

import re
import runpy
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from cellctl.calibration import EFFECTS
from cellctl.cli.verbs import app
from cellctl.compensation import METHODS
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.error_maps.terms import TERMS
from cellctl.files import load_yaml
from cellctl.formats import RobotFile, load_artefact
from cellctl.formats.cell_sections import currents_of
from cellctl.formats.load import load_of
from cellctl.formats.measurements import KINDS
from cellctl.operations.studies.study_file import Study
from cellctl.procedure import StepRegistry, checked_parameters, load_procedure
from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv
from tests.helpers.runs import CELL, ROOT, cellctl

DOCS = sorted((ROOT / "docs").rglob("*.md"))
DATA = ROOT.parent / "shared" / "data"
UR10 = DATA / "ur10_tracker" / "measurements_grid.csv"
MEASURED = {"measurements_grid.csv": UR10, "iiwa14_sockets": DATA / "iiwa14_sockets"}
"""Measurements of real robots, by the names that documents call them; they are not in the repository."""
FRONT = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
_SHOWN_FILE = re.compile(r"^```\w+ (\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
"""A block that shows a file, whose path from the document stands behind the language."""
_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A block of code: its language, its text, and where it stands."""

    file: Path
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line}"


def blocks(language: str) -> list[Block]:
    found = []
    for file in DOCS:
        text = file.read_text(encoding="utf-8")
        found += [
            Block(file, text.count("\n", 0, match.start()) + 1, language, match[2])
            for match in _BLOCK.finditer(text)
            if match[1] == language
        ]
    return found


def shells() -> list[list[Block]]:
    """The bash blocks of each document, in order: together they are one session."""
    by_file: dict[Path, list[Block]] = {}
    for block in blocks("bash"):
        by_file.setdefault(block.file, []).append(block)
    return list(by_file.values())


def session(parts: list[Block], folder: Path, timeout: float) -> subprocess.CompletedProcess[str]:
    """Run blocks as one shell session that ends at the first error, with the repository's folders beside it."""
    for name in ("procedures", "docs"):
        (folder / name).symlink_to(ROOT / name)
    tools = folder / ".tools"
    tools.mkdir()
    for name, words in (("cellctl", "-m cellctl "), ("python", "")):
        (tools / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {words}"$@"\n')
        (tools / name).chmod(0o755)
    script = "set -euo pipefail\n" + "".join(part.text for part in parts)
    for name, source in MEASURED.items():
        if name in script:
            if not source.exists():
                pytest.skip(f"{source} is not here: see docs/reference/data-sets.md, public data sets")
            (folder / name).symlink_to(source)
    return subprocess.run(
        ["bash", "-c", f'export PATH="{tools}:$PATH"\n{script}'],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


def shown_lines(file: Path) -> list[str]:
    """What a document shows as the answers of its commands."""
    texts = [block.text for block in blocks("text") if block.file == file]
    return [line for text in texts for line in text.splitlines() if line.strip() not in ("", "…")]


def pattern_of(line: str) -> str:
    """A line as it has to be said: words with digits may differ (another machine, another day), `…` is anything."""
    words = [r"\S+" if re.search(r"\d", word) else re.escape(word).replace("…", ".*") for word in line.split()]
    return r"^\s*" + r"\s+".join(words) + r"\s*$"


MOST_COMMANDS = 8


def _marks(parts: list[Block]) -> list[pytest.MarkDecorator]:
    """Documents that take a user through a whole story take as long as the story."""
    text = "".join(part.text for part in parts)
    whole = [pytest.mark.campaign, pytest.mark.long] if "cellctl run" in text else []
    many = text.count("cellctl ") > MOST_COMMANDS or any(name in text for name in MEASURED)
    return whole or ([pytest.mark.long] if many else [])


@pytest.mark.long
@pytest.mark.timeout(1500)
@pytest.mark.parametrize("parts", [pytest.param(each, id=str(each[0]), marks=_marks(each)) for each in shells()])
def test_the_commands_of_a_document_run_as_shown(parts: list[Block], tmp_path: Path) -> None:
    done = session(parts, tmp_path, 1480.0)
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    said = f"{done.stdout}\n{done.stderr}"
    missing = [line for line in shown_lines(parts[0].file) if not re.search(pattern_of(line), said, re.MULTILINE)]
    assert missing == [], f"shown, and not said:\n{said[-6000:]}"


@pytest.fixture(scope="module")
def shown_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the programs of the documents read."""
    folder = tmp_path_factory.mktemp("shown")
    _write_table(folder)
    return folder


def _on_real_data(block: Block) -> bool:
    """Whether made-up numbers do not do: the program fits the measurements."""
    return "measurements_grid.csv" in block.text and "cellctl.fit" in block.text


@pytest.mark.parametrize(
    "block",
    [
        pytest.param(each, id=str(each), marks=[pytest.mark.long] if _on_real_data(each) else [])
        for each in blocks("python")
    ],
)
def test_the_programs_of_a_document_run(
    block: Block, shown_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(shown_files, tmp_path, dirs_exist_ok=True)
    if _on_real_data(block):
        if not UR10.exists():
            pytest.skip(f"{UR10} is not here: see docs/reference/data-sets.md, public data sets")
        shutil.copy(UR10, tmp_path)
    program = tmp_path / "shown.py"
    program.write_text(block.text)
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(program), run_name="__main__")


@pytest.mark.parametrize("block", blocks("yaml"), ids=str)
def test_the_files_in_a_document_are_good_ones(block: Block, tmp_path: Path) -> None:
    _beside_the_shipped_files(tmp_path)
    content: dict[str, Any] = yaml.safe_load(block.text)
    file = tmp_path / "procedures" / "cells" / "shown.yaml"
    match content:
        case {"procedure": _}:
            file = tmp_path / "procedures" / "shown.yaml"
            file.write_text(block.text)
            checked_parameters(load_procedure(file), [], StepRegistry.installed(), None)
        case {"convention": _}:
            file.write_text(block.text)
            RobotFile.load(file)
        case {"load": _}:
            file.write_text(block.text)
            assert load_of(load_yaml(file))
        case {"sockets": _}:
            file.write_text(block.text)
            load_artefact(file)
        case {"model": _}:
            file.write_text(block.text)
            cell = Cell.load(file, DriverRegistry())
            assert cell.addresses.keys() == content["devices"].keys()
            if "currents" in content:
                currents_of(cell.document, 6)
        case {"simulate": _}:
            shipped = CELL.read_text().partition("\nsimulate:")[0] + "\n"
            file.write_text(shipped + block.text)
            done = cellctl("check", ROOT / "procedures" / "sphere_selfcal.yaml", "--cell", file)
            assert done.returncode == 0, done.stderr
        case {"study": _}:
            file.write_text(block.text)
            assert Study.load(file).units
        case {"report": _} | {"acceptance": _}:
            file.write_text(CELL.read_text() + block.text)
            Cell.load(file, DriverRegistry())
        case _:
            raise AssertionError("a kind of file that this test does not know")


def test_the_files_that_documents_show_are_those_that_there_are() -> None:
    shown = set()
    for page in (ROOT / "docs" / "extend").glob("*.md"):
        for path, text in _SHOWN_FILE.findall(page.read_text(encoding="utf-8")):
            assert text == (page.parent / path).read_text(encoding="utf-8"), f"{page.name} shows another {path}"
            shown.add((page.parent / path).resolve())
    files = [file for kind in ("*/*/*.py", "*/*/*.yaml") for file in (ROOT / "docs" / "examples").glob(kind)]
    packages = {file for file in files if file.parent.name != "tests" and file.name != "__init__.py"}
    assert packages - shown == set(), "each module of an example package is shown"


@pytest.mark.parametrize("file", [*DOCS, *FRONT], ids=lambda file: str(file.relative_to(ROOT)))
def test_the_links_of_a_document_lead_somewhere(file: Path) -> None:
    text = _SHOWN_FILE.sub("", _BLOCK.sub("", file.read_text(encoding="utf-8")))
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if "://" not in target:
            assert (file.parent / target).exists(), f"{target} does not exist"


def test_the_index_names_every_document() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    missing = [
        str(file.relative_to(ROOT / "docs"))
        for file in DOCS
        if file.parent.name != "decisions" and file.name != "index.md"
        if str(file.relative_to(ROOT / "docs")) not in index
    ]
    assert missing == []


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("effects.md", [kind.group for kind in EFFECTS]),
        ("error-maps.md", [term.group for term in TERMS]),
        ("compensation.md", list(METHODS)),
        ("data-sets.md", [name for kind in KINDS.values() for name in (*kind.columns, *kind.filled_by)]),
    ],
)
def test_the_reference_has_every_effect_map_method_and_column_of_a_row_kind(page: str, names: list[str]) -> None:
    text = (ROOT / "docs" / "reference" / page).read_text(encoding="utf-8")
    assert [name for name in names if f"`{name}`" not in text] == []


def test_the_documents_name_every_verb_that_they_promise() -> None:
    """A command in the running text is one that the command line has."""
    listed = cellctl("--help").stdout
    for file in [*DOCS, *FRONT]:
        for verb in re.findall(r"`cellctl ([a-z]+)", file.read_text(encoding="utf-8")):
            assert re.search(rf"^\s+{verb}\s", listed, re.MULTILINE), f"{file.name}: there is no 'cellctl {verb}'"


def test_the_front_page_shows_commands_with_options_that_there_are() -> None:
    """Its commands need files that only their users have; what they are called with can be asked all the same."""
    shown = re.findall(
        r"uv run cellctl ([a-z]+(?: [a-z]+)?) ([^#\n]*)", (ROOT / "README.md").read_text(encoding="utf-8")
    )
    assert len(shown) > 10
    for words, rest in shown:
        verb = words.split() if words.startswith("table") else words.split()[:1]
        told = CliRunner().invoke(app, [*verb, "--help"])
        assert told.exit_code == 0, f"there is no 'cellctl {' '.join(verb)}'"
        for option in re.findall(r"(?<!\S)--?[a-z]+", rest):
            assert re.search(rf"{option}\b", told.stdout), f"'cellctl {' '.join(verb)}' has no {option}"


def _beside_the_shipped_files(folder: Path) -> None:
    (folder / "procedures" / "cells").mkdir(parents=True)
    (folder / "procedures" / "robots").symlink_to(ROOT / "procedures" / "robots")
    for file in CELL.parent.iterdir():
        (folder / "procedures" / "cells" / file.name).symlink_to(file)


def _write_table(folder: Path) -> None:
    """`table.json` for two targets, as the command line makes it."""
    kr5_model().save(folder / "model.json")
    (folder / "targets.csv").write_text(targets_csv(readings_near_the_middle(2)))
    made = (
        "compensate",
        folder / "model.json",
        folder / "targets.csv",
        "--serial",
        "SIM-1",
        "-o",
        folder / "table.json",
    )
    done = cellctl(*made)
    assert done.returncode == 0, done.stderr
