"""The studies: one runner lists all, goes on after an interruption, and makes tables from kept rows."""

from __future__ import annotations

import inspect
import os
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from tests.studies._runner import CODE, KEPT, Table, code_version, keep, load, main, write_into

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "papers.md"

TINY = """
import os, sys, time
from pathlib import Path
from tests.studies._runner import Study, Table

def units(asked):
    return ({"case": "a", "seed": seed} for seed in asked.seeds)

def measure(case, seed):
    with Path("computed").open("a") as file:
        file.write(f"{seed}\\n")
    if seed == 3 and not Path("go on").exists():
        time.sleep(100)
    return {"square": seed**2, "threads": os.environ["OPENBLAS_NUM_THREADS"]}

def tables(found, asked):
    yield Table(" ".join(str(row["square"]) for row in found))

STUDY = Study(units, measure, tables, seeds=5)
"""
NAMES = [
    *(path.stem for path in sorted((ROOT / "tests" / "studies").glob("*.py")) if not path.stem.startswith("_")),
    "papers",
]
CALL = [sys.executable, "-c", "import sys, tiny; sys.exit(tiny.STUDY.run('tiny', sys.argv[1:]))"]


def test_the_runner_lists_every_study_with_a_line():
    done = subprocess.run([sys.executable, "-m", "tests.studies"], cwd=ROOT, capture_output=True, text=True, check=True)
    lines = [line.split(maxsplit=1) for line in done.stdout.splitlines()]
    assert {name: bool(text) for name, text in lines} == dict.fromkeys(NAMES, True)


@pytest.mark.parametrize("name", NAMES)
def test_a_study_has_distinct_units_that_it_can_measure_or_a_main_of_its_own(name):
    module = import_module(f"tests.studies.{name}")
    if not hasattr(module, "STUDY"):
        assert list(inspect.signature(module.main).parameters) == ["words"]
        return
    units = list(module.STUDY.units(module.STUDY.asked(name, [])))
    for unit in units:
        inspect.signature(module.STUDY.measure).bind(**unit)
    assert units
    assert len({tuple(unit.items()) for unit in units}) == len(units)


@pytest.fixture
def tiny(tmp_path):
    """Calls a tiny study in a folder; its third seed takes long until the file `go on` is there."""
    (tmp_path / "tiny.py").write_text(TINY)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "4"}

    def call(*words):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
        return subprocess.Popen([*CALL, *words], cwd=tmp_path, env=environment, **pipes)

    return call


@pytest.mark.parametrize("ended_by", [signal.SIGINT, signal.SIGKILL])
def test_a_study_goes_on_after_an_interruption_and_computes_no_row_twice(tiny, tmp_path, ended_by):
    rows = tmp_path / "runs" / "studies" / CODE / "tiny.jsonl"
    interrupted = tiny()
    assert any("seed 2" in line for line in interrupted.stderr)
    os.killpg(interrupted.pid, ended_by)
    interrupted.communicate()
    assert [row["seed"] for row in load(rows)] == [1, 2]
    with rows.open("a") as file:
        file.write('{"case": "a", "seed": 3, "squ')
    (tmp_path / "go on").touch()
    for words in ([], [], ["--processes", "2"], ["--kept"]):
        again = tiny(*words)
        assert again.communicate()[0] == "1 4 9 16 25\n"
        assert again.returncode == 0
    computed = (tmp_path / "computed").read_text().split()
    assert sorted(computed) in ([*"12345"], [*"123345"]), "the seed that was interrupted is begun again"
    assert sorted(row["seed"] for row in load(rows)) == [1, 2, 3, 4, 5]
    assert {(row["threads"], row["code"]) for row in load(rows)} == {("1", CODE)}


def test_changed_code_has_rows_of_its_own(tmp_path):
    source = tmp_path / "cellctl" / "a.py"
    source.parent.mkdir()
    source.write_text("A = 1\n")
    before = code_version(tmp_path)
    assert code_version(tmp_path) == before
    source.write_text("A = 2\n")
    assert code_version(tmp_path) != before


def test_kept_computes_nothing(tiny, tmp_path):
    kept = tiny("--kept")
    assert "no rows" in kept.communicate()[1]
    assert kept.returncode == 1
    assert not (tmp_path / "computed").exists()


def test_the_kept_rows_of_the_papers_make_their_page(tmp_path, capsys):
    page = tmp_path / "papers.md"
    page.write_text(PAGE.read_text(encoding="utf-8").replace("yes (10 of 10)", "old"), encoding="utf-8")
    before = (KEPT / "papers.jsonl").read_bytes()
    assert main(["papers", "--kept", "--write", str(page)]) == 0
    assert page.read_text(encoding="utf-8") == PAGE.read_text(encoding="utf-8")
    assert (KEPT / "papers.jsonl").read_bytes() == before
    assert capsys.readouterr().out.count("## ") > 4


def test_written_rows_replace_those_of_the_same_cases(tmp_path):
    file = tmp_path / "kept.jsonl"
    keep(file, [{"paper": paper, "seed": 1} for paper in "ab"], [{"paper": paper, "seed": 1} for paper in "ab"])
    keep(file, [{"paper": "a", "seed": 2}], [{"paper": "a", "seed": 2, "numbers": {}}])
    assert load(file) == [{"paper": "b", "seed": 1}, {"paper": "a", "seed": 2, "numbers": {}}]


def test_only_what_is_between_the_marks_is_replaced(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- figures: made by hand -->\nold\n<!-- end of figures -->\nafter\n")
    write_into(page, Table("new", "figures"))
    assert page.read_text() == "before\n<!-- figures: made by hand -->\nnew\n<!-- end of figures -->\nafter\n"


def test_a_page_without_marks_is_refused(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("nothing\n")
    with pytest.raises(RuntimeError, match="end of figures"):
        write_into(page, Table("new", "figures"))


def test_an_unknown_study_is_answered_by_the_list(capsys):
    assert main(["nothing"]) == 2
    assert len(capsys.readouterr().out.splitlines()) == len(NAMES)
