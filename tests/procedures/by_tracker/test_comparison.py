"""A model from touches, judged by the points that an instrument measures on the same arm: a robot of the tests' own."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.devices import MeasuredPoint
from cellctl.files import load_yaml
from cellctl.formats import DataSet, ModelFile
from cellctl.procedure import NoInputs
from procedures.steps.by_tracker.verdict import ByTrackerFigures, ByTrackerVerdict, JudgedPosesRow, judge
from procedures.steps.sphere.rows import SphereVerdict
from procedures.steps.sphere.touching import IdentifyInputs, identify
from procedures.steps.tracker.rows import PoseRow, SetUpRow
from tests.helpers.own_campaigns import Campaign
from tests.helpers.own_model import pose_of
from tests.helpers.runs import ROOT
from tests.helpers.simulated_setups import KR5_REGION, KR5_SIGNS
from tests.helpers.steps import Context, touch

PROCEDURES = ROOT / "procedures"
CELL = PROCEDURES / "cells" / "sphere_tracker_cell.yaml"
SPHERES = np.array([[950.0, -350.0, 250.0], [950.0, 350.0, 250.0], [1150.0, 0.0, 400.0]])
CERTIFIED = {(0, 1): "700.412", (1, 2): "430.263", (0, 2): "430.018"}
REFLECTOR = np.array([120.6, -0.4, 60.3, 1.0])
"""True place in the flange frame, mm: not where the cell file has it."""
STATION = pose_of(Rotation.from_euler("z", 90.0, degrees=True), np.array([2500.0, -900.0, 700.0]))
"""The robot's base in the instrument's frame: the instrument's x is the base's −y."""

NOISE_MM = np.array([0.05, 0.05, 0.05])
POSES = 70


@dataclass(frozen=True)
class Judged:
    """The end of a campaign: its context, the verdict, and the errors at the held-out poses."""

    context: Any
    verdict: ByTrackerVerdict
    poses: JudgedPosesRow

    @property
    def figures(self) -> ByTrackerFigures:
        assert self.verdict.by_tracker is not None
        return self.verdict.by_tracker


def run_of(
    folder: Path,
    seen: Callable[[np.ndarray], np.ndarray] = lambda points: points,
    noise: np.ndarray = NOISE_MM,
    last: Any = judge,
) -> Any:
    """The context of touches on three spheres and poses, of one robot, after the step `last`; `seen`: what the
    instrument makes of places in its frame.

    noise (3,): 1 σ along the instrument's axes, mm.
    """
    campaign = Campaign.of(5)
    campaign = replace(campaign, truth=replace(campaign.truth, base=np.eye(4)))
    cell = folder / "cell.yaml"
    text = CELL.read_text().replace("../robots/", f"{PROCEDURES}/robots/")
    for (a, b), old in CERTIFIED.items():
        text = text.replace(old, f"{np.linalg.norm(SPHERES[a] - SPHERES[b]):.3f}")
    cell.write_text(text)
    rows = [*_touches(campaign), _set_up(), *_poses(campaign, seen, noise)]
    robot_file = PROCEDURES / "robots" / "kr5_r1400.yaml"
    context: Any = Context(rows=rows, run_folder=folder, robot_file=robot_file, cell=load_yaml(cell))
    asyncio.run(identify(context, IdentifyInputs(model="geometry")))
    asyncio.run(last(context, NoInputs()))
    return context


def judged_run(folder: Path, **differently: Any) -> Judged:
    """A run (`run_of`) that ends in a verdict by the tracker."""
    context = run_of(folder, **differently)
    return Judged(context, context.recorded(ByTrackerVerdict)[-1], context.recorded(JudgedPosesRow)[-1])


def _touches(campaign: Campaign) -> list[Any]:
    rows = campaign.touches(80, SPHERES, 0.02)
    return [
        touch(number=number, sphere=f"S{point + 1}", set="fit" if number < 50 else "test", joints=q, resting=q)
        for number, (q, point) in enumerate(zip(_readings(np.asarray(rows.q)), rows.point, strict=True))
    ]


def _set_up() -> SetUpRow:
    return SetUpRow(
        levelled=True,
        weather=None,
        temperatures=None,
        load="none",
        payload_kg=0.0,
        payload_xyz=(0.0, 0.0, 0.0),
        reflector_mm=0.0,
    )


def _poses(campaign: Campaign, seen: Callable[[np.ndarray], np.ndarray], noise: np.ndarray) -> list[PoseRow]:
    random = np.random.default_rng(3)
    q = random.uniform(KR5_REGION[0], KR5_REGION[1], (POSES, 6))
    points = seen((STATION @ campaign.truth.flange(q) @ REFLECTOR)[:, :3])
    points = points + random.normal(0.0, noise, points.shape)
    return [
        PoseRow(
            number=number,
            reflector="R1",
            joints=joints,
            commanded=joints,
            direction=(1,) * 6,
            visit=0,
            arm_c=None,
            currents=None,
            point=_point(xyz, noise),
            attempt=1,
            set="fit" if number % 2 else "test",
        )
        for number, (joints, xyz) in enumerate(zip(_readings(q), points.tolist(), strict=True))
    ]


def _point(xyz: list[float], noise: np.ndarray) -> MeasuredPoint:
    x, y, z = (noise**2).tolist()
    return MeasuredPoint(
        xyz=tuple(xyz),
        covariance=((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)),
        common=((0.0,) * 3,) * 3,
        samples=3,
        scatter=(0.0, 0.0, 0.0),
        faces=1,
        hz_rad=0.0,
        v_rad=0.0,
        range_mm=2000.0,
        time_ns=1,
        device_ms=1,
        levelled=True,
        weather=None,
        accuracy="at960",
        noise_only=True,
    )


def _readings(q: np.ndarray) -> list[tuple[float, ...]]:
    return [tuple(row) for row in (KR5_SIGNS * np.degrees(q)).tolist()]


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Judged:
    return judged_run(tmp_path_factory.mktemp("judged"))


def test_the_model_from_the_touches_is_better_than_nominal_and_the_trackers_own_is_the_floor(judged: Judged) -> None:
    figures = judged.figures
    assert judged.verdict.verdict == "better"
    nominal, touches, tracker = (each.errors.rms for each in (figures.nominal, figures.touches, figures.tracker))
    assert nominal is not None
    assert touches is not None
    assert tracker is not None
    assert nominal > 4 * touches > 4 * tracker
    assert (figures.n_fit, figures.n_test) == (35, 35)


def test_the_error_of_the_model_from_the_touches_is_the_one_that_it_predicts(judged: Judged) -> None:
    model = judged.figures.touches
    assert model.predicted_rms is not None
    assert model.errors.rms is not None
    assert 0.6 < model.predicted_rms / model.errors.rms < 1.7
    assert model.coverage_95 is not None
    assert model.coverage_95 > 0.8


def test_figures_are_those_of_the_recorded_errors(judged: Judged) -> None:
    for name in ("nominal", "touches", "tracker"):
        lengths = np.linalg.norm(np.array(getattr(judged.poses, name)), axis=1)
        errors = getattr(judged.figures, name).errors
        assert (errors.mean, errors.rms, errors.max) == pytest.approx(
            (lengths.mean(), np.sqrt(np.mean(lengths**2)), lengths.max())
        )


def test_the_model_from_the_touches_takes_registration_alone_from_the_tracker(judged: Judged) -> None:
    folder = judged.context.run_folder
    before = ModelFile.load(folder / "model.json")
    assert {centre.id for centre in before.centres} == {"S1", "S2", "S3"}
    held_out = judged.context.recorded(SphereVerdict)[0]
    assert judged.verdict.held_out is not None
    assert (judged.verdict.model, judged.verdict.held_out.after) == (held_out.model, held_out.after)
    data = DataSet.load(folder / "tracker.csv")
    assert len(data) == POSES
    assert ModelFile.load(folder / "tracker_model.json").provenance["data_sha256"] == data.sha256


def test_the_result_states_that_the_profile_is_noise_only_and_that_nothing_was_pushed(judged: Judged) -> None:
    (line,) = [line for line in judged.verdict.lines if line.startswith("Instrument")]
    assert "at960 (the noise of such an instrument only, not its behaviour)" in line
    assert "Nothing was pushed" in line


@pytest.mark.long
def test_an_instrument_with_another_scale_than_the_spheres_is_seen_in_the_scale(judged: Judged, tmp_path: Path) -> None:
    stretched = judged_run(tmp_path, seen=lambda points: 1.001 * points)
    true, other = (each.figures.touches.directions for each in (judged, stretched))
    assert other.scale_ppm - true.scale_ppm == pytest.approx(1000.0, abs=50.0)
    assert abs(true.scale_ppm) < 200.0


@pytest.mark.long
def test_errors_are_along_the_axes_of_the_robots_base(tmp_path: Path) -> None:
    found = judged_run(tmp_path, noise=np.array([0.3, 0.01, 0.01])).figures.tracker.directions
    assert found.y == pytest.approx(0.3, rel=0.35)
    assert max(found.x, found.z) < 0.1
