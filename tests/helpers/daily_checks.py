"""Journals of daily checks, made in milliseconds: ten points and four nests with known noise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cellctl.journal import Journal, Recorded, RunStarted, SourceFile, StateChanged

NESTS = np.array([[2000.0, -800.0, 100.0], [2600.0, 900.0, 150.0], [1500.0, 1000.0, 1200.0], [2200.0, -900.0, 1500.0]])
POINTS = np.random.default_rng(1).uniform([700.0, -600.0, 300.0], [1300.0, 600.0, 1200.0], (10, 3))
NOISE_MM = 0.02


def check(folder: Path, number: int, *, grown: float = 0.0, state: str = "finished", **other: Any) -> None:
    """The journal of check `number` in `folder`, by an instrument that stands elsewhere each day.

    grown: relative growth of the robot; other: fields of its points that differ.
    """
    rng = np.random.default_rng(number)
    angle, shift = rng.uniform(-1.0, 1.0), rng.uniform(-500.0, 500.0, 3)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    middle = POINTS.mean(axis=0)
    seen = middle + (1.0 + grown) * (POINTS - middle) + rng.normal(0.0, NOISE_MM, POINTS.shape)
    day = {
        "baseline": "first",
        "robot": "925185",
        "payload_kg": 5.0,
        "accuracy": "tdra6000",
        "commanded": [[0.0] * 6] * len(POINTS),
        "points": (seen @ turn.T + shift).tolist(),
        "nest_names": ["N1", "N2", "N3", "N4"],
        "nests": (NESTS @ turn.T + shift).tolist(),
        "spread": [(1e-6 * np.eye(3)).tolist()] * 4,
        **other,
    }
    verdict = {"verdict": "in control", "sentence": "As in the baseline.", "daily": {"baseline_needed": 20, "t2": 3.5}}
    source, began = (
        SourceFile("daily_check.yaml", "", ""),
        f"2026-{1 + number // 28:02d}-{1 + number % 28:02d}T08:00:00Z",
    )
    day = {name: each for name, each in day.items() if each is not None}
    with Journal.create(folder / f"check-{number:02d}", lambda: 0) as journal:
        journal.append(
            RunStarted(source, source, {}, 1, "lockstep", "me", began, "", {}, section=("daily", "accuracy"))
        )
        journal.append(Recorded("daily points", {"day": day}))
        journal.append(Recorded("verdict", verdict))
        journal.append(StateChanged("running", state, ""))
