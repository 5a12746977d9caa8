"""Where imports stand: at the top, but for the verbs, the families of steps, and what a comment gives a reason for."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import cellctl
from cellctl.cli.verbs import VERBS
from cellctl.installed import shipped
from cellctl.journal import Journal, RunStarted, SourceFile
from cellctl.procedure import StepRegistry
from tests.helpers.runs import CELL, FASTEST, ROOT, quick_cell, touches_procedure
from tests.helpers.tracker import FEW

PACKAGES = ("cellctl", "drivers", "procedures", "sims")
MOST_IN_FUNCTIONS = 80
SLOW = ("numpy", "scipy", "rich", "cellctl.calibration", "cellctl.formats")


@cache
def nodes_of(file: Path) -> list[ast.AST]:
    """Of its syntax tree, in breadth."""
    return list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))


def imports_in_functions() -> dict[str, str]:
    """Place → its line, of each import inside a function."""
    found = {}
    for file in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        lines = file.read_text(encoding="utf-8").splitlines()
        for function in nodes_of(file):
            if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
                for node in ast.walk(function):
                    if isinstance(node, ast.Import | ast.ImportFrom):
                        place = f"{file.relative_to(ROOT)}:{node.lineno}"
                        found[place] = "\n".join(lines[node.lineno - 1 : node.end_lineno])
    return found


@pytest.mark.long
def test_few_imports_stand_in_functions_and_each_has_its_reason_beside_it():
    found = imports_in_functions()
    without = {place: line for place, line in found.items() if "#" not in line and "cellctl/cli/main.py" not in place}
    assert without == {}, "a comment on the line says why it is not at the top; main.py has one comment for all"
    assert len(found) <= MOST_IN_FUNCTIONS


def modules() -> dict[str, Path]:
    """Name → file of each of our modules."""
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    parts = [(file.relative_to(ROOT).with_suffix("").parts, file) for file in files]
    return {".".join(part for part in names if part != "__init__"): file for names, file in parts}


def imported(file: Path, ours: dict[str, Path]) -> set[str]:
    """Those of `ours` that a module imports: at its top, in functions, for type checkers, and by `import_module`."""
    found = set()
    for node in nodes_of(file):
        match node:
            case ast.Import(names):
                found |= {alias.name for alias in names}
            case ast.ImportFrom(module=str(module), names=names):
                found |= {name if (name := f"{module}.{alias.name}") in ours else module for alias in names}
            case ast.Call(func=ast.Name("import_module"), args=[ast.Constant(str(name))]):
                found.add(name)
    return found & ours.keys()


def test_no_modules_import_each_other_in_a_circle():
    ours = modules()
    graph = {name: imported(file, ours) for name, file in ours.items()}
    assert graph["cellctl"] == {"cellctl.facade", "cellctl.version"}, "the names of `import cellctl` lead to the facade"
    TopologicalSorter(graph).prepare()  # raises CycleError with the modules of a circle


@pytest.mark.parametrize("name", VERBS)
def test_a_verb_is_where_the_table_says_with_that_help(name):
    verb = VERBS[name]
    found = getattr(importlib.import_module(f"cellctl.cli.{verb.module}"), verb.name)
    text = inspect.getdoc(found) if inspect.isfunction(found) else found.info.help
    assert text.split("\n\n")[0].replace("\n", " ") == verb.help


def test_the_names_that_are_loaded_at_first_use_are_stated_for_type_checkers_too():
    stub = ast.parse(Path(cellctl.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imported = {
        alias.asname or alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assigned = {node.target.id for node in stub.body if isinstance(node, ast.AnnAssign)}
    assert {name for name in imported | assigned if name != "__all__"} == set(cellctl.__all__)
    for name in cellctl.__all__:
        assert getattr(cellctl, name) is not None


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "slow"),
    [
        *((words, SLOW) for words in (["--help"], ["status"], ["pause"], ["abort"])),
        (["robots"], ("scipy", "cellctl.calibration", "cellctl.formats")),
    ],
    ids=lambda given: given[0] if isinstance(given, list) else "",
)
def test_a_verb_that_only_asks_or_stops_imports_nothing_slow(words, slow, tmp_path):
    assert [name for name in slow if name in modules_of_a_call(words, tmp_path)] == []


def test_the_status_of_a_run_imports_no_function_of_its_steps(tmp_path):
    """Titles and expected passes come from the descriptions of the steps, here of all that are installed."""
    names = StepRegistry.installed().names()
    steps = "".join(f"  - {{id: s{number}, do: {name}}}\n" for number, name in enumerate(names))
    source = SourceFile("all.yaml", f"procedure: all\ntitle: all\nsteps:\n{steps}", "")
    with Journal.create(tmp_path / "run", lambda: 1) as journal:
        journal.append(RunStarted(source, source, {}, 1, "lockstep", "", "2026-11-22T10:00:00Z", "", {}))
    loaded = modules_of_a_call(["status", "run"], tmp_path)
    assert {"procedures.steps.sphere", "procedures.steps.tracker"} <= set(loaded)
    assert [name for name in SLOW if name in loaded] == []


def modules_of_a_call(words, folder):
    """The names of all modules that `cellctl WORDS` imports."""
    code = (
        "import json, sys; sys.argv = ['cellctl', *sys.argv[1:]]\n"
        "from cellctl.cli.main import main\n"
        "try: main()\n"
        "finally: print(json.dumps(sorted(sys.modules)), file=sys.stderr)"
    )
    ended = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, cwd=folder)
    loaded = json.loads(ended.stderr.splitlines()[-1])
    assert "cellctl.cli.verbs" in loaded
    return loaded


BETWEEN = """
import sys
from pathlib import Path
import cellctl.operations.launch as launch
from cellctl.cli.verbs import app
run_on, roots = launch.run_on, ("cellctl", "drivers", "procedures", "numpy", "scipy")
async def watched(*given):
    before = set(sys.modules)
    try:
        return await run_on(*given)
    finally:
        new = sorted(name for name in set(sys.modules) - before if name.split(".")[0] in roots)
        Path("imported").write_text(" ".join(new))
launch.run_on = watched
app(sys.argv[1:], standalone_mode=False)
"""


@pytest.mark.long
@pytest.mark.campaign
def test_a_run_imports_nothing_of_ours_numpy_or_scipy_between_connecting_and_its_end(tmp_path):
    touches = touches_procedure(tmp_path)
    words = ["run", str(touches), "--cell", str(quick_cell(tmp_path)), "--runs", str(tmp_path)]
    subprocess.run([sys.executable, "-c", BETWEEN, *words], cwd=tmp_path, check=False, capture_output=True)
    assert (tmp_path / "imported").read_text() == ""


@pytest.mark.long
@pytest.mark.campaign
@pytest.mark.parametrize(
    "words",
    [
        ["sphere_selfcal", "sphere_cell", "touches_fit=24", "touches_test=6", "standoff_targets=4", *FASTEST],
        ["tracker_calibration", "tracker_cell", *(f"{name}={value}" for name, value in FEW.items() if name != "model")],
    ],
    ids=lambda words: words[0],
)
def test_a_whole_campaign_imports_nothing_of_ours_numpy_or_scipy_between_connecting_and_its_end(words, tmp_path):
    procedure, name, *settings = words
    given = [f"--set={setting}" for setting in settings]
    cell = quick_cell(tmp_path, shipped=CELL.parent / f"{name}.yaml")
    code = [sys.executable, "-c", BETWEEN, "run", procedure, *given, "--cell", str(cell), "--runs", str(tmp_path)]
    subprocess.run(code, cwd=tmp_path, check=False, capture_output=True)
    assert (tmp_path / "imported").read_text() == ""


BY_STRING = {
    "cellctl/__init__.py": "the names of `import cellctl`",
    "cellctl/cli/verbs.py": "a verb's module",
    "cellctl/console/server.py": "pages and routers",
    "cellctl/operations/cell_devices.py": "the simulators, a process",
    "cellctl/operations/launch.py": "scipy, before a run connects",
    "cellctl/operations/run_control.py": "a detached run, a process",
    "cellctl/operations/studies/campaign_units.py": "a run of a study, a process",
    "cellctl/operations/worker.py": "operations in another process",
    "cellctl/procedure/registry.py": "the modules of a family of steps, before a run connects",
    "drivers/kuka_rsi/robot/rsi_process.py": "the RSI process",
}
"""Modules that import by a string, or start one of our programs by its name, and what; entry points apart."""


def test_arrows_that_no_import_shows_are_listed():
    found = set()
    for file in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for node in nodes_of(file):
            called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id
            if called in {"import_module", "__import__"} or (isinstance(node, ast.Constant) and node.value == "-m"):
                found.add(str(file.relative_to(ROOT)))
    assert found == set(BY_STRING)


KNOW_NO_CAMPAIGN = ("cli", "console", "engine", "facade", "journal", "operations", "procedure", "report")


def test_services_console_and_engine_name_no_shipped_procedure_step_or_row_kind_but_in_docstrings():
    campaigns = "\n".join(file.read_text(encoding="utf-8") for file in (ROOT / "procedures").rglob("*.py"))
    kinds = re.findall(r'KIND: ClassVar\[str\] = "(\w+[ _]\w[^"]*)"', campaigns)  # one word may mean something else
    steps = re.findall(r'@step\(\s*"([^"]+)"', campaigns)
    assert min(len(kinds), len(steps), len(shipped("procedure"))) > 10
    name = re.compile(rf"\b({'|'.join(map(re.escape, [*kinds, *steps, *shipped('procedure')]))})\b")
    found = []
    for file in (path for top in KNOW_NO_CAMPAIGN for path in (ROOT / "cellctl" / top).rglob("*.py")):
        nodes = nodes_of(file)
        docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        texts = (node for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str))
        found += [f"{file}: {each.value}" for each in texts if id(each) not in docstrings and name.search(each.value)]
    assert found == []
