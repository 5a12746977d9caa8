"""Spheres and tracker on one robot of the tests' own, each calibrated by itself: whether they agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.calibration.verdict.agreement import AgreementFigures
from cellctl.formats import ModelFile
from procedures.steps.by_tracker.agreeing import CrossCheckVerdict, cross_check
from tests.procedures.by_tracker.test_comparison import run_of


@dataclass(frozen=True)
class Checked:
    context: Any
    verdict: CrossCheckVerdict

    @property
    def figures(self) -> AgreementFigures:
        assert self.verdict.agreement is not None
        assert self.verdict.agreement.figures is not None
        return self.verdict.agreement.figures


def check(folder: Path, seen: Callable[[np.ndarray], np.ndarray] = lambda points: points) -> Checked:
    """A campaign whose instrument makes `seen` of the places in its frame."""
    context = run_of(folder, seen, last=cross_check)
    return Checked(context, context.recorded(CrossCheckVerdict)[-1])


@pytest.fixture(scope="module")
def checked(tmp_path_factory: pytest.TempPathFactory) -> Checked:
    return check(tmp_path_factory.mktemp("checked"))


def test_two_right_calibrations_agree_and_the_run_passes(checked: Checked) -> None:
    assert (checked.verdict.verdict, checked.verdict.passed) == ("agree", True)
    found = checked.figures
    assert found.within >= 0.9
    assert found.limits[0] <= found.distance <= found.limits[1]
    assert checked.verdict.sentence.startswith("The calibrations agree: ")


def test_both_models_are_in_the_run_folder_and_none_used_the_others_rows(checked: Checked) -> None:
    touches, tracker = (
        ModelFile.load(checked.context.run_folder / name) for name in ("model.json", "tracker_model.json")
    )
    assert touches.centres
    assert not tracker.centres
    assert touches.provenance["data_sha256"] != tracker.provenance["data_sha256"]


def test_an_instrument_with_a_wrong_scale_disagrees_and_the_scale_is_named(tmp_path: Path) -> None:
    found = check(tmp_path, lambda points: 1.0005 * points)
    assert (found.verdict.verdict, found.verdict.passed) == ("disagree", False)
    assert found.figures.scale_ppm == pytest.approx(500.0, abs=4.0 * found.figures.scale_sigma_ppm)
