"""A plant's folder of runs: many robots, each with a daily check a day and a calibration now and then.

Each journal is made by the journal's own writer, with a few events; several at once in processes of their own.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from cellctl.journal import DevicesConnected, Journal, Recorded, RunEnded, RunStarted, SourceFile, StateChanged
from cellctl.records import Figures, VerdictRow

FIRST = datetime(2026, 1, 1, 6)
CELL = "name: cell\nreport: {site: hall 3}\n"
POINTS, NESTS, NOISE_MM = 10, 4, 0.02


@contextmanager
def not_durable() -> Iterator[None]:
    """Inside this context no file is forced to the disk: a made run that a power cut takes is made again."""
    with patch("os.fsync", lambda _: None):
        yield


def made_runs(folder: Path, robots: int, days: int, *, first_robot: int = 0) -> None:
    """The runs of some robots on some days, in `folder`."""
    with not_durable():
        for robot in range(first_robot, first_robot + robots):
            for day in range(days):
                made_check(folder, robot, day)


def made_check(folder: Path, robot: int, day: int, *more: Any) -> Path:
    """The daily check of a robot on a day; more: further events before its end."""
    began = FIRST + timedelta(days=day, seconds=robot)
    name = f"daily_check-{began:%Y%m%dT%H%M%SZ}"
    calendar = f"{began:%Y-%m-%dT%H:%M:%SZ}"
    source, cell = (
        SourceFile("procedures/daily_check.yaml", "procedure: daily_check\n", ""),
        SourceFile("cell.yaml", CELL, ""),
    )
    section = ("daily", "accuracy", "noise_only")
    started = RunStarted(source, cell, {}, 1, "lockstep", "Kim", calendar, "", {}, name=name, section=section)
    verdict = {"verdict": "in control", "sentence": "As in the baseline.", "daily": {"baseline_needed": 20, "t2": 3.5}}
    identity = {"serial": f"R{robot:05d}", "model": f"KR{robot % 3}", "firmware": "8.6", "simulated": True}
    write(
        folder / name,
        started,
        DevicesConnected({"robot": identity}),
        StateChanged("connecting", "running"),
        Recorded("daily points", {"day": _day(robot, day)}),
        Recorded("verdict", verdict),
        *more,
        StateChanged("running", "finished"),
        RunEnded("finished", "in control", calendar=calendar),
    )
    return folder / name


def made_calibration(folder: Path, robot: int, day: int, model: Path) -> Path:
    """A finished calibration of a robot, with a model."""
    began = FIRST + timedelta(days=day, hours=4, seconds=robot)
    name, calendar = f"calibration-{began:%Y%m%dT%H%M%SZ}", f"{began:%Y-%m-%dT%H:%M:%SZ}"
    source, cell = SourceFile("procedures/calibration.yaml", "", ""), SourceFile("cell.yaml", CELL, "")
    figures = Figures(1.0, 1.1, 2.0)
    write(
        folder / name,
        RunStarted(source, cell, {}, 1, "lockstep", "Kim", calendar, "", {}, name=name, section=()),
        DevicesConnected({"robot": {"serial": f"R{robot:05d}", "model": f"KR{robot % 3}", "firmware": "8.6"}}),
        Recorded.of(VerdictRow("better", "Error at held-out targets.", figures, figures), "", 1),
        StateChanged("running", "finished"),
        RunEnded("finished", "better", calendar=calendar),
    )
    shutil.copy(model, folder / name / "model.json")
    return folder / name


def write(folder: Path, *events: Any) -> None:
    """A run with these events, and no process."""
    with Journal.create(folder, lambda: 0) as journal:
        journal._connection.execute("PRAGMA synchronous = OFF")
        journal._connection.execute("BEGIN")
        for event in events:
            journal.append(event)
        journal._connection.execute("COMMIT")


def _day(robot: int, day: int) -> dict[str, Any]:
    """Points and nests of a check, mm: those of its robot, with noise."""
    own, rng = np.random.default_rng(robot), np.random.default_rng([robot, day])
    points, nests = own.uniform(-900.0, 900.0, (POINTS, 3)), own.uniform(-1500.0, 1500.0, (NESTS, 3))
    return {
        "baseline": "first",
        "robot": f"R{robot:05d}",
        "payload_kg": 5.0,
        "accuracy": "tdra6000",
        "commanded": [[0.0] * 6] * POINTS,
        "points": np.round(points + rng.normal(0.0, NOISE_MM, points.shape), 4).tolist(),
        "nest_names": [f"N{number}" for number in range(NESTS)],
        "nests": np.round(nests + rng.normal(0.0, NOISE_MM, nests.shape), 4).tolist(),
        "spread": [(1e-6 * np.eye(3)).tolist()] * NESTS,
    }
