"""Robots on a rail, on a lift, and with a quill, from positions of a tracker (10 minutes).

A KR5 with ordinary errors (0.04° and 0.3 mm, 1 σ). The carriage has a scale error of 200 ppm, leans by 1 mrad, and
deviates by 0.25 mm and 0.1 mrad from straight, as no polynomial does (`tests.helpers.sliding_robots`). 200 poses to
fit, 100 held out. Floor: the noise of robot (0.03 mm) and instrument (0.02 mm on each axis).
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cellctl.operations.fit_options import Asked, Judging
from cellctl.operations.fitting import FitInput, fit_rows
from tests.helpers.sliding_robots import FLOOR_MM, KINDS, SCALE, write_case
from tests.studies._runner import Row, Study, Table, each

MODELS = ("geometry", "geometry+scale", "auto")


def units(asked: Namespace) -> Iterator[Row]:
    """Each kind of robot with each model."""
    return each(seed=asked.seeds, kind=KINDS, model=MODELS)


def measure(seed: int, kind: str, model: str) -> Row:
    """Held-out errors, mm, before and after; the scale found and its 1 σ, ppm."""
    asked = Asked("position", model, None, True, (), "base", None, None)
    with TemporaryDirectory() as folder:
        given = FitInput.load(*write_case(Path(folder), kind, seed=seed), asked)
        found = fit_rows(given, asked, Judging(None, None, "set", None, 0), check=True, processes=1)
    scale = [(1e6 * row.value, 1e6 * row.sigma) for row in found.model().parameters if row.name.startswith("scale")]
    report = found.report
    return {
        "before": report["nominal"]["mean"],
        "after": report["test"]["mean"],
        "kept": report["model"],
        "coverage_95": report["coverage_95"],
        "scale_ppm": scale[0] if scale else None,
    }


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """Means over the robots."""
    lines = [
        "| robot | model | robots | before | after | after / floor | in the 95 % region | scale, error / σ (RMS) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind in KINDS:
        for model in MODELS:
            mine = [row for row in found if (row["kind"], row["model"]) == (kind, model)]
            if mine:
                before, after, inside = (
                    float(np.mean([row[name] for row in mine])) for name in ("before", "after", "coverage_95")
                )
                scales = [(row["scale_ppm"][0] - 1e6 * SCALE) / row["scale_ppm"][1] for row in mine if row["scale_ppm"]]
                score = f"{np.sqrt(np.mean(np.square(scales))):.1f}" if scales else "–"
                figures = f"{before:.3f} | {after:.3f} | {after / FLOOR_MM:.2f} | {100.0 * inside:.0f} % | {score}"
                lines.append(f"| {kind} | `{model}` | {len(mine)} | {figures} |")
    yield Table("\n".join(lines), "prismatic joints")


STUDY = Study(units, measure, tables, seeds=5, first=0, writes=True)
