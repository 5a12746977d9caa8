"""Ten runs of one seed, five of them on a busy machine over slow wires: is it one data set? (about 20 minutes)

    python tests/studies/same_bytes.py [--runs 10] [--seed 1] [--procedure procedures/sphere_selfcal.yaml]

Prints the SHA-256 of each run's dataset.csv, and of the cell's times of all events in its journal. Exit 0 where each is
one and the same.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))

from cell_runs import busy_machine  # noqa: E402 - found by the line above

from cellctl.journal import read_journal  # noqa: E402


def hashes(procedure: Path, seed: int, folder: Path, environment: dict[str, str]) -> tuple[str, str]:
    """Run the campaign; SHA-256 of its data set, and of the times in its journal (tables are named after their run)."""
    command = [sys.executable, "-m", "cellctl", "run", str(procedure), "--seed", str(seed), "--runs", str(folder)]
    subprocess.run(command, env={**os.environ, **environment}, cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
    run = next(folder.glob("*/journal.sqlite")).parent
    times = "\n".join(f"{entry.time_ns} {type(entry.event).__name__}" for entry in read_journal(run))
    return _sha((run / "dataset.csv").read_bytes()), _sha(times.encode())


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def main() -> int:
    """Run, print, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--procedure", type=Path, default=ROOT / "procedures" / "sphere_selfcal.yaml")
    asked = parser.parse_args()
    found = set()
    for number in range(asked.runs):
        disturbed = number % 2 == 1
        environment = {"PYTHONPATH": str(ROOT / "tests" / "helpers" / "slow_wires")} if disturbed else {}
        with tempfile.TemporaryDirectory() as folder, busy_machine() if disturbed else nullcontext():
            found.add(pair := hashes(asked.procedure, asked.seed, Path(folder), environment))
        print(f"{'busy machine, slow wires' if disturbed else 'nothing beside it':26}", *pair, flush=True)
    print(f"{asked.runs} runs: {len(found)} different")
    return 0 if len(found) == 1 else 1


if __name__ == "__main__":
    sys.exit(main())
