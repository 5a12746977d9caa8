"""What one sphere can see: residual on the sphere against the volumetric error, one sphere and three, several robots.

    uv run python tests/studies/one_sphere.py [--seeds 5] [--write docs/results/campaigns.md]

Runs `sphere_single` and `sphere_selfcal` (one and a half minutes on two cores) on each simulated robot, asks the
simulated world how far each identified robot is from the truth all over the workspace, and prints a Markdown table;
with --write it replaces the one between the marks in that file. A study and no test: it judges nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from cell_runs import CELL, ROOT, cellctl
from volumetric import volumetric_errors

from cellctl.formats import ModelFile

PROCEDURES = {
    "one sphere": ("sphere_single", CELL.parent / "single_sphere_cell.yaml"),
    "three spheres, certified distances": ("sphere_selfcal", CELL),
}
HEAD = (
    "| seed | set-up | held out on the sphere, mean, nominal (mm) | identified "
    "| volumetric RMS, identified (mm) | its maximum |",
    "|---|---|---|---|---|---|",
)
BEGIN, END = "<!-- one-sphere figures:", "<!-- end of one-sphere figures -->"


@dataclass(frozen=True)
class Figures:
    """One campaign: held-out distances to the sphere's surface, and distances to the truth over the workspace, mm."""

    seed: int
    setup: str
    nominal_mean: float
    identified_mean: float
    volumetric_rms: float
    volumetric_max: float

    def row(self) -> str:
        numbers = (self.nominal_mean, self.identified_mean, self.volumetric_rms, self.volumetric_max)
        return f"| {self.seed} | {self.setup} | " + " | ".join(f"{number:.3f}" for number in numbers) + " |"


def measured(setup: str, seed: int, folder: Path) -> Figures:
    """Run one campaign. Raises RuntimeError where it does not come to a verdict."""
    procedure, cell = PROCEDURES[setup]
    result_file = folder / "result.json"
    runs = ("--runs", folder / "runs", "--json", result_file)
    done = cellctl("run", ROOT / "procedures" / f"{procedure}.yaml", "--seed", str(seed), *runs, timeout=600.0)
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr)
    result = json.loads(result_file.read_text())
    held_out = result["held_out"] or {"before": result["before"], "after": result["after"]}
    model = ModelFile.load(folder / "runs" / result["run"] / "model.json")
    errors = volumetric_errors(model, cell, seed, folder)
    rms, most = float(np.sqrt(np.mean(errors**2))), float(errors.max())
    return Figures(seed, setup, held_out["before"]["mean"], held_out["after"]["mean"], rms, most)


def study(seeds: int) -> list[Figures]:
    """Every set-up on every seed from 1."""
    found = []
    for seed in range(1, seeds + 1):
        for setup in PROCEDURES:
            with tempfile.TemporaryDirectory() as folder:
                found.append(measured(setup, seed, Path(folder)))
            print(found[-1].row(), file=sys.stderr, flush=True)
    return found


def write_into(document: Path, table: str) -> None:
    """Replace the table between the marks."""
    before, begin, rest = document.read_text(encoding="utf-8").partition(BEGIN)
    mark, _, _ = rest.partition("\n")
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise RuntimeError(f"{document} has no place for the figures")
    document.write_text(f"{before}{begin}{mark}\n{table}\n{end}{after}", encoding="utf-8")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Residual on the sphere against the volumetric error.")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--write", type=Path)
    asked = parser.parse_args()
    table = "\n".join([*HEAD, *(figures.row() for figures in study(asked.seeds))])
    print(table)
    if asked.write:
        write_into(asked.write, table)


if __name__ == "__main__":
    main()
