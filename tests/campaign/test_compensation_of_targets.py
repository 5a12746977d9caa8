"""Two iterated methods on the heavy-robot cell over the wires: 80 held-out targets come near to the floor."""

from __future__ import annotations

from pathlib import Path

import pytest
from verified_targets import HEAVY_CELL, MOST_MM, OVER_FLOOR, Verified, calibrated, verified

pytestmark = [pytest.mark.campaign, pytest.mark.long]

SEED = 1


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("methods")


@pytest.fixture(scope="module")
def model_run(folder: Path) -> Path:
    """A calibration from the paper's 160 poses."""
    return calibrated(SEED, folder)


@pytest.mark.parametrize("method", ["pseudo-target", "cyclic-search"])
def test_an_iterated_method_brings_80_targets_of_the_heavy_robot_near_the_floor(
    folder: Path, model_run: Path, method: str
) -> None:
    found = Verified.of(verified(SEED, model_run, folder, method), HEAVY_CELL, SEED)
    assert len(found.after) == 80
    assert found.before.mean() > 0.5
    assert found.after.max() <= MOST_MM
    assert found.ratio.ratio <= OVER_FLOOR
