"""Two runs of one robot: whether their calibrations agree, and when that is not judged."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cellctl.files import sha256_of
from cellctl.formats import ModelFile
from cellctl.formats.model import JointRegion
from cellctl.formats.type_prior import USED
from cellctl.operations.agreement import models_agree
from cellctl.operations.comparing_runs import compare_runs
from tests.helpers.arms import KR5_MIDDLE, cellctl, kr5_model, readings_near_the_middle
from tests.helpers.journals import run_in


def calibration(seed: int, off: float = 1.0, **provenance: str) -> ModelFile:
    """The KR5, measured at 60 postures, with errors of `off` σ."""
    model, rng = kr5_model(**provenance), np.random.default_rng(seed)
    parameters = [
        each.model_copy(
            update={
                "value": each.value + (off * rng.normal() * each.sigma if each.sigma else 0.0),
                "prior_sigma": 20.0 * each.sigma,
            }
        )
        for each in model.parameters
    ]
    postures = readings_near_the_middle(60, seed)
    low, high = KR5_MIDDLE - 30.0, KR5_MIDDLE + 30.0
    region = JointRegion(min=low.tolist(), max=high.tolist(), postures=postures.tolist(), length=40.0)
    return model.model_copy(update={"parameters": parameters, "joint_region": region})


def runs(folder: Path, a: ModelFile, b: ModelFile, data: tuple[str, str] = ("A1\n1\n", "A1\n2\n")) -> tuple[Path, Path]:
    for month, (name, model, rows) in enumerate(zip("ab", (a, b), data, strict=True), 1):
        run_in(folder, name, f"2026-{month:02d}-10", "925185")
        model.save(folder / name / "model.json")
        (folder / name / "dataset.csv").write_text(rows)
    return folder / "a", folder / "b"


def test_two_calibrations_of_one_robot_agree_on_the_screen_and_in_the_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = runs(tmp_path, calibration(7), calibration(8))
    assert cellctl("show", a, "--against", b, "--json", tmp_path / "compared.json") == 0
    said = capsys.readouterr().out
    assert "The calibrations agree: " in said
    assert "directions that both determined" in said
    found = json.loads((tmp_path / "compared.json").read_text())["agreement"]
    assert found["verdict"] == "agree"
    assert found["figures"]["within"] >= 0.9
    assert found["places"] > 100


def test_calibrations_further_apart_than_their_sigmas_disagree(tmp_path: Path) -> None:
    found = compare_runs(*runs(tmp_path, calibration(1, 4.0), calibration(2, 4.0))).agreement
    assert found is not None
    assert found.verdict == "disagree"


def test_rows_that_are_in_both_data_sets_are_counted_and_nothing_is_judged(tmp_path: Path) -> None:
    data = ("A1\n1\n2\n3\n", "A1\n2\n3\n4\n")
    found = compare_runs(*runs(tmp_path, calibration(1), calibration(2), data))
    assert found.agreement is None
    assert found.no_agreement == "2 rows are in the data sets of both: they would agree by these"


@pytest.mark.parametrize(
    ("a", "b", "why"),
    [
        ({"data_sha256": "1"}, {"data_sha256": "1"}, "from the same rows"),
        ({"robot_serial": "SN1"}, {"robot_serial": "SN2"}, "of different robots, SN1 and SN2"),
        ({"prior_sha256": "1"}, {"prior_sha256": "1"}, "updated from the same prior model"),
        ({USED: "1"}, {USED: "1"}, "a prior of the type"),
    ],
)
def test_calibrations_whose_errors_are_correlated_are_not_compared(
    a: dict[str, str], b: dict[str, str], why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        models_agree(calibration(1, **a), calibration(2, **b))


def test_an_update_is_not_compared_with_the_model_that_it_was_made_from() -> None:
    older = calibration(1)
    with pytest.raises(ValueError, match="one was updated from the other"):
        models_agree(older, calibration(2, prior_sha256=sha256_of(older.text())))


def test_regions_without_common_postures_are_not_compared() -> None:
    a, b = calibration(1), calibration(2)
    away = b.joint_region.model_copy(
        update={"min": [80.0, *b.joint_region.min[1:]], "max": [90.0, *b.joint_region.max[1:]]}
    )
    with pytest.raises(ValueError, match="0 measured postures are in the joint region of both"):
        models_agree(a, b.model_copy(update={"joint_region": away}))
