"""Ten runs of one seed, five of them on a busy machine over slow wires: is it one data set? (about 20 minutes)

Prints the SHA-256 of each run's dataset.csv, and of the cell's times of all events in its journal. Exit 0 where each is
one and the same.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

from cellctl.journal import read_journal
from tests.helpers.runs import ROOT, busy_machine, only_run
from tests.studies._runner import Row, Study, Table, each


def units(asked: Namespace) -> Iterator[Row]:
    """So many runs, each second one disturbed."""
    return each(procedure=[str(asked.procedure)], of_seed=[asked.seed], run=range(asked.runs))


def measure(procedure: str, of_seed: int, run: int) -> Row:
    """SHA-256 of the run's data set, and of the times in its journal (tables are named after their run)."""
    disturbed = run % 2 == 1
    environment = {"PYTHONPATH": str(ROOT / "tests" / "helpers" / "slow_wires")} if disturbed else {}
    with tempfile.TemporaryDirectory() as folder, busy_machine() if disturbed else nullcontext():
        command = [sys.executable, "-m", "cellctl", "run", procedure, "--seed", str(of_seed), "--runs", folder]
        subprocess.run(command, env={**os.environ, **environment}, cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
        found = only_run(Path(folder))
        times = "\n".join(f"{entry.time_ns} {type(entry.event).__name__}" for entry in read_journal(found))
        hashes = [hashlib.sha256(part).hexdigest() for part in ((found / "dataset.csv").read_bytes(), times.encode())]
    return {"beside": "busy machine, slow wires" if disturbed else "nothing beside it", "hashes": hashes}


def _different(found: list[Row]) -> int:
    return len({tuple(row["hashes"]) for row in found})


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """The hashes of each run."""
    lines = [f"{row['beside']:26} {' '.join(row['hashes'])}" for row in found]
    yield Table(
        "\n".join(
            [*lines, f"{len(found)} runs, data sets that differ: {_different(found) if _different(found) > 1 else 0}"]
        )
    )


OPTIONS = {
    "--runs": {"type": int, "default": 10},
    "--seed": {"type": int, "default": 1},
    "--procedure": {"type": Path, "default": ROOT / "procedures" / "sphere_selfcal.yaml"},
}
STUDY = Study(units, measure, tables, options=OPTIONS, passed=lambda found: _different(found) == 1)
