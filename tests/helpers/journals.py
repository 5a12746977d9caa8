"""Journals of runs, made in milliseconds: for the console's scene, of daily checks, and of finished campaigns.

The scene's hold touches on spheres, and poses with a tracker. The nominal robot of the touches touches the spheres
exactly; joints are found by the tests' own arm. Daily checks have ten points and four nests with known noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.journal import (
    DevicesConnected,
    Entry,
    Journal,
    Outcome,
    Recorded,
    RunEnded,
    RunStarted,
    RunState,
    SourceFile,
    StateChanged,
    StepEnded,
    StepStarted,
    fold,
)
from cellctl.records import Figures, VerdictRow
from tests.helpers.own_model import Floats, OwnArm, kr5
from tests.helpers.simulated_setups import KR5_SIGNS

SEARCH = {
    "time_ns": 0,
    "time_sigma_ns": 0,
    "tick": 0,
    "bounces": 0,
    "stop_cycles": 2,
    "late": 0,
    "lost": 0,
    "skipped": 0,
    "attempt": 1,
}
"""What every contact of a run records of its search."""

ROOT = Path(__file__).parents[2]
ROBOT = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
SPHERE_CELL = ROOT / "procedures" / "cells" / "sphere_cell.yaml"
TRACKER_CELL = ROOT / "procedures" / "cells" / "tracker_cell.yaml"
SPHERES = {"S1": (950.0, -350.0, 250.0), "S2": (950.0, 350.0, 250.0), "S3": (1150.0, 0.0, 400.0)}
REACH = 61.4 / 2 + 0.6
START = KR5_SIGNS * np.radians([0.0, -70.0, 80.0, 0.0, 60.0, 0.0])

NESTS = np.array([[2000.0, -800.0, 100.0], [2600.0, 900.0, 150.0], [1500.0, 1000.0, 1200.0], [2200.0, -900.0, 1500.0]])
POINTS = np.random.default_rng(1).uniform([700.0, -600.0, 300.0], [1300.0, 600.0, 1200.0], (10, 3))
NOISE_MM = 0.02


@dataclass
class MadeJournal:
    """Events of a run, in order."""

    cell: Path = SPHERE_CELL
    events: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        robot, cell = (SourceFile(str(path), path.read_text(), "") for path in (ROBOT, self.cell))
        procedure = SourceFile("made.yaml", "procedure: made\n", "")
        self.events.append(RunStarted(procedure, cell, {}, 1, "lockstep", "", "", "", {}, robot))

    def step(self, name: str, result: Any = None) -> None:
        """A step that is done."""
        self.events += [StepStarted(name, 1, False), StepEnded(name, 1, Outcome.DONE, result)]

    def row(self, kind: str, data: dict[str, Any]) -> None:
        """A row that counts."""
        self.events.append(Recorded(kind, data))

    def state(self) -> RunState:
        """The fold of all events."""
        return fold(Entry(seq, seq, event) for seq, event in enumerate(self.events, 1))


def readings_at(places: Floats, arm: OwnArm | None = None) -> list[list[float]]:
    """Readings, deg, that put the nominal TCP (or that of `arm`) at `places` (N, 3), mm."""
    q = (arm or kr5()).reaching(np.asarray(places), np.tile(START, (len(places), 1)))
    return np.round(np.degrees(q) * KR5_SIGNS, 9).tolist()


def touch_places(count: int) -> tuple[list[str], Floats, Floats]:
    """Spheres, places (N, 3) of the TCP at contact, and normals (N, 3)."""
    random = np.random.default_rng(3)
    names = [f"S{number % 3 + 1}" for number in range(count)]
    tilt, around = random.uniform(0.1, 1.3, count), random.uniform(-np.pi, np.pi, count)
    normals = np.stack([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)], axis=1)
    return names, np.array([SPHERES[name] for name in names]) + REACH * normals, normals


def touch_row(number: int, sphere: str, readings: Sequence[float]) -> dict[str, Any]:
    """A touch as its step records it; every fourth is held out."""
    held_out = number % 4 == 3
    joints = list(readings)
    return {"number": number, "sphere": sphere, "set": "test" if held_out else "fit", "joints": joints, **SEARCH} | {
        "resting": joints
    }


def touch_run(planned: int, measured: int) -> MadeJournal:
    """A run that has planned touches and measured the first ones."""
    names, places, normals = touch_places(planned)
    readings, beyond = readings_at(places), readings_at(places - 8.0 * normals)
    made = MadeJournal()
    plans = [
        {"number": number, "sphere": name, "set": touch_row(number, name, [])["set"], "end": end}
        for number, (name, end) in enumerate(zip(names, beyond, strict=True))
    ]
    made.step("plan", {"touches": plans})
    for number in range(measured):
        made.row("touch", touch_row(number, names[number], readings[number]))
    return made


def residuals_row(
    readings: Sequence[Sequence[float]], before: Sequence[float], after: Sequence[float]
) -> dict[str, Any]:
    """The stored residuals of rows with these readings, each along z, mm."""
    n = len(readings)
    along_z = ([[0.0, 0.0, value] for value in values] for values in (before, after))
    none, zeros = [None] * n, [0] * n
    return {
        **dict.fromkeys(("line", "row", "session"), zeros),
        **dict.fromkeys(("number", "point"), [""] * n),
        **dict.fromkeys(("on_sphere", "held_out", "outlier"), [False] * n),
        "readings": [list(each) for each in readings],
        **dict.fromkeys(("tip", "tip_base", "normal", "turn"), [[None] * 3] * n),
        "before": next(along_z),
        "after": next(along_z),
        **dict.fromkeys(("signed_before", "signed_after", "p_value"), none),
        **dict.fromkeys(("joint_before", "joint_after", "scaled"), [[None] * 6] * n),
    }


STATION = np.eye(4)
STATION[:3, :3], STATION[:3, 3] = Rotation.from_euler("Z", 150.0, degrees=True).as_matrix(), [3390.0, -1190.0, 905.0]
"""The instrument in the robot's base frame, some mm from where the cell file says."""
REFLECTOR = (120.0, 0.0, 80.0)
"""R1 of the shipped cell, in the flange frame, mm."""


def reflector_arm() -> OwnArm:
    """The robot with its first reflector as the tool."""
    tool = np.eye(4)
    tool[:3, 3] = REFLECTOR
    return OwnArm(kr5().table, frozenset({2}), tool=tool)


def seen(place: Floats) -> list[float]:
    """A place (3,) of the base frame in the instrument's."""
    return (STATION[:3, :3].T @ (np.asarray(place) - STATION[:3, 3])).tolist()


def visited_row(number: int, readings: Sequence[float], xyz: Sequence[float]) -> dict[str, Any]:
    """A measured reflector as its step records it; xyz: in the instrument's frame, mm."""
    small = (np.eye(3) * 1e-4).tolist()
    point = {
        "xyz": list(xyz),
        **dict.fromkeys(("covariance", "common"), small),
        "scatter": [0.01] * 3,
        **dict.fromkeys(("samples", "faces"), 1),
        **dict.fromkeys(("hz_rad", "v_rad", "range_mm"), 0.0),
        **dict.fromkeys(("time_ns", "device_ms"), 0),
        "levelled": True,
        "weather": None,
        "accuracy": "made",
        "noise_only": True,
        "warnings": [],
    }
    return {
        "number": number,
        "reflector": "R1",
        "joints": list(readings),
        "commanded": list(readings),
        "direction": [1] * 6,
        "visit": 1,
        "arm_c": None,
        "currents": None,
        "point": point,
        "attempt": 1,
    }


def station_row() -> dict[str, Any]:
    """The instrument, found by axes turned."""
    return {"session": "1", "source": "axes turned", "matrix": STATION.tolist()}


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


def run_in(
    folder: Path,
    name: str,
    day: str,
    serial: str,
    verdict: str = "better",
    procedure: str = "sphere",
    cell: str = "hall7",
) -> Path:
    """The folder of a finished run of `procedure` on a robot, begun at 8:00 of `day`."""
    source, place = SourceFile(f"procedures/{procedure}.yaml", "", ""), SourceFile(f"{cell}.yaml", "", "")
    with Journal.create(folder / name, lambda: 0) as journal:
        journal.append(
            RunStarted(source, place, {}, 1, "lockstep", "Kim", f"{day}T08:00:00Z", "", {}, name=name, section=())
        )
        identity = {"serial": serial, "model": "KR5 R1400", "firmware": "8.6", "simulated": serial.startswith("SIM-")}
        journal.append(DevicesConnected({"robot": identity}))
        figures = Figures(1.0, 1.1, 2.0)
        journal.append(Recorded.of(VerdictRow(verdict, "Error at held-out targets.", figures, figures), "", 1))
        journal.append(StateChanged("running", "finished"))
        journal.append(RunEnded("finished", verdict))
    return folder / name
