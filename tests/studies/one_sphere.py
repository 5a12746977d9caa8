"""What one sphere can see: residual on the sphere against the volumetric error, one sphere and three, several robots.

Runs `sphere_single` and `sphere_selfcal` (one and a half minutes on two cores) on each simulated robot, asks the
simulated world how far each identified robot is from the truth all over the workspace, and prints a Markdown table. A
study and no test: it judges nothing.
"""

from __future__ import annotations

import json
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cellctl.formats import ModelFile
from tests.helpers.runs import CELL, ROOT, cellctl_process
from tests.helpers.simulated_data import volumetric_errors
from tests.studies._runner import Row, Study, Table, each

PROCEDURES = {
    "one sphere": ("sphere_single", CELL.parent / "single_sphere_cell.yaml"),
    "three spheres, certified distances": ("sphere_selfcal", CELL),
}
HEAD = (
    "| seed | set-up | held out on the sphere, mean, nominal (mm) | identified "
    "| volumetric RMS, identified (mm) | its maximum |",
    "|---|---|---|---|---|---|",
)


def measure(seed: int, setup: str) -> Row:
    """One campaign: held-out distances to the sphere's surface, and distances to the truth over the workspace, mm.

    Raises RuntimeError where it does not come to a verdict.
    """
    procedure, cell = PROCEDURES[setup]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        result_file = folder / "result.json"
        runs = ("--runs", folder / "runs", "--json", result_file)
        done = cellctl_process(
            "run", ROOT / "procedures" / f"{procedure}.yaml", "--seed", str(seed), *runs, timeout=600.0
        )
        if done.returncode not in (0, 1):
            raise RuntimeError(done.stderr)
        result = json.loads(result_file.read_text())
        model = ModelFile.load(folder / "runs" / result["run"] / "model.json")
        errors = volumetric_errors(model, cell, seed, folder)
    held_out = result["held_out"] or {"before": result["before"], "after": result["after"]}
    return {
        "nominal_mean": held_out["before"]["mean"],
        "identified_mean": held_out["after"]["mean"],
        "volumetric_rms": float(np.sqrt(np.mean(errors**2))),
        "volumetric_max": float(errors.max()),
    }


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """A line for each campaign."""
    names = ("nominal_mean", "identified_mean", "volumetric_rms", "volumetric_max")
    numbers = (" | ".join(f"{row[name]:.3f}" for name in names) for row in found)
    lines = (f"| {row['seed']} | {row['setup']} | {each} |" for row, each in zip(found, numbers, strict=True))
    yield Table("\n".join([*HEAD, *lines]), "one-sphere figures")


STUDY = Study(lambda asked: each(seed=asked.seeds, setup=PROCEDURES), measure, tables, seeds=5, writes=True)
