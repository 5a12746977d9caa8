"""A unit of a study of campaigns: a procedure on its simulated cell, by `cellctl run` in its own process and folder."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from cellctl.files import InputError, Problem
from cellctl.installed import shipped_file
from cellctl.operations.campaign import load_campaign

SETTINGS: dict[str, Any] = {"procedure": None, "cell": ""}
"""procedure, cell: a file or a shipped name; no cell: the procedure's own. `set.NAME`: parameter of the procedure."""

PLOTTED = ("after_rms", "after_mean")

RUNS = "runs"
FINISHED = (0, 1)
"""Exit codes of a run that came to its verdict."""

_SAID = 600


def check(folder: Path, unit: dict[str, Any]) -> None:
    """Raise InputError where the run would be refused, or its cell is a real one; files are relative to `folder`."""
    procedure, cell, settings = _words(folder, unit)
    campaign = load_campaign(procedure, cell, settings, seed=0, resumed=False, runs=folder)
    if not campaign.cell.simulated:
        what = "is a real cell: a study runs its campaigns without a person beside"
        raise InputError(Problem(campaign.cell.document.file, 0, 0, what, "name a simulated cell"))


def measure(beside: str, folder: str, keep: str, **unit: Any) -> dict[str, Any]:
    """How the run ended, and the figures of its verdict, mm.

    beside: folder that files are relative to; folder: the study's, in whose `runs` a run is kept: `none`, `failed` (no
    verdict) or `all`. Raises RuntimeError where the run did not begin.
    """
    place = Path(folder)
    place.joinpath(RUNS).mkdir(parents=True, exist_ok=True)
    name = "-".join(str(value).replace("/", "_") for value in (Path(str(unit["procedure"])).stem, unit["seed"]))
    runs = Path(tempfile.mkdtemp(prefix=f"{name}-", dir=place / RUNS))
    kept = False
    try:
        found, ended = _result(Path(beside), unit, runs)
        kept = keep == "all" or (keep == "failed" and ended not in FINISHED)
        return {**found, "exit_code": ended}
    finally:
        if not kept:
            shutil.rmtree(runs, ignore_errors=True)


def _words(folder: Path, unit: dict[str, Any]) -> tuple[Path, Path | None, list[str]]:
    """Procedure, cell and parameters as `cellctl run` takes them."""
    beside = {name: folder / str(unit[name]) for name in ("procedure", "cell")}
    procedure, cell = beside["procedure"], None
    if not procedure.is_file():
        procedure = shipped_file("procedure", Path(str(unit["procedure"])))
    if unit["cell"]:
        cell = beside["cell"] if beside["cell"].is_file() else shipped_file("cell", Path(str(unit["cell"])))
    given = {name[len("set.") :]: value for name, value in unit.items() if name.startswith("set.")}
    return procedure, cell, [f"{name}={json.dumps(value)}" for name, value in given.items()]


def _result(beside: Path, unit: dict[str, Any], runs: Path) -> tuple[dict[str, Any], int]:
    procedure, cell, settings = _words(beside, unit)
    command = [sys.executable, "-m", "cellctl", "run", str(procedure), "--seed", str(unit["seed"])]
    command += ["--runs", str(runs), "--json", str(runs / "result.json"), "--confirm-all"]
    command += ["--cell", str(cell)] if cell else []
    for words in settings:
        command += ["--set", words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    file = runs / "result.json"
    if not file.exists():
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: {done.stderr.strip()[-_SAID:]}")
    result = json.loads(file.read_text(encoding="utf-8"))
    figures = {
        f"{when}_{name}": (result[when] or {}).get(name)
        for when in ("before", "after")
        for name in ("mean", "rms", "max")
    }
    known = {*unit, "wall_s"}
    numbers = {k: value for k, value in result.items() if isinstance(value, bool | int | float) and k not in known}
    return {"state": result["state"], "verdict": result["verdict"], **figures, **numbers}, done.returncode
