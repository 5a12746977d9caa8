"""Two runs side by side, the difference of their models with its σ, and drifts over many runs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cellctl.calibration.verdict.agreement import difference_covariance
from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile
from cellctl.journal import Journal, Recorded, RunStarted, SourceFile
from cellctl.operations.comparing_models import model_difference
from cellctl.operations.comparing_runs import compare_runs, parameter_drift
from cellctl.operations.run_indexing import run_rows
from tests.helpers.arms import KR5_ERRORS, kr5_model
from tests.helpers.journals import run_in

SIGMA_MM, SIGMA_RAD = 0.05, 5e-5


def model_with(**errors: float) -> ModelFile:
    """The KR5's model with its errors changed: by what a test says, mm and rad."""
    return kr5_model(errors={**KR5_ERRORS, **errors})


def test_the_covariance_of_a_difference_is_that_of_simulated_fits_with_a_common_prior() -> None:
    """Two fits of the same robots; the rows of a and b determine other combinations, and none a third parameter."""
    rng, prior = np.random.default_rng(1), np.array([1.0, 4.0, 0.25])
    rows_a, rows_b = np.array([[3.0, 1.0, 0.0], [0.0, 2.0, 0.0]]), np.array([[1.0, -1.0, 0.0]])
    truth = rng.normal(size=(100_000, 3)) * np.sqrt(prior)

    def fits(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        covariance = np.linalg.inv(rows.T @ rows + np.diag(1.0 / prior))
        measured = truth @ rows.T + rng.normal(size=(len(truth), len(rows)))
        return measured @ rows @ covariance, covariance

    (found_a, cov_a), (found_b, cov_b) = fits(rows_a), fits(rows_b)
    expected = difference_covariance(cov_a, prior, cov_b, prior)
    assert expected == pytest.approx(np.cov((found_b - found_a).T), abs=0.03)
    assert expected[2] == pytest.approx(np.zeros(3), abs=1e-12)


def test_a_changed_parameter_is_significant_and_the_others_are_not() -> None:
    found = model_difference(model_with(), model_with(d4=KR5_ERRORS["d4"] + 0.4))
    first, others = found.parameters[0], found.parameters[1:]
    assert (first.name, first.label, first.unit, first.significant) == ("d4", "d4", "mm", True)
    assert first.difference == pytest.approx(0.4)
    assert first.sigma == pytest.approx(np.sqrt(2.0) * SIGMA_MM, rel=0.01)
    assert not any(each.significant for each in others)
    assert found.sentence.startswith("The models differ")


def test_without_a_change_one_comparison_in_twenty_says_that_the_models_differ() -> None:
    rng, reference = np.random.default_rng(3), model_with()
    names = [each.name for each in reference.parameters if each.sigma > 0.0]
    sigmas = np.array([each.sigma for each in reference.parameters if each.sigma > 0.0])
    wrong = 0
    for _ in range(40):
        a, b = (kr5_model(errors=dict(zip(names, rng.normal(0.0, sigmas), strict=True))) for _ in range(2))
        wrong += model_difference(a, b).p_value < 0.05
    assert wrong <= 7  # 2 expected at most; 99.9 % of binomial draws


def test_angles_are_in_degrees() -> None:
    found = model_difference(model_with(), model_with(theta2=KR5_ERRORS["theta2"] + 1e-3))
    (theta2,) = (each for each in found.parameters if each.name == "theta2")
    assert theta2.unit == "°"
    assert theta2.difference == pytest.approx(np.degrees(1e-3))


def test_a_parameter_that_no_row_determines_has_no_sigma_of_its_difference() -> None:
    wide = model_with()
    parameters = [
        each.model_copy(update={"prior_sigma": each.sigma}) if each.name == "d1" else each for each in wide.parameters
    ]
    wide = wide.model_copy(update={"parameters": parameters})
    (d1,) = (each for each in model_difference(wide, model_with()).parameters if each.name == "d1")
    assert (d1.sigma, d1.significant) == (None, None)


def test_the_tcps_of_the_models_are_compared_without_base_and_tool() -> None:
    """Another tool and joint zero of A1 are no change of the arm; a link that is longer by 0.4 mm is one."""
    same = model_difference(model_with(), model_with(tool_x=5.0, theta1=0.002))
    assert same.tcp_max_mm == pytest.approx(0.0, abs=1e-3)
    longer = model_difference(model_with(), model_with(a2=KR5_ERRORS["a2"] + 0.4))
    assert longer.tcp_rms_mm is not None
    assert longer.tcp_sigma_mm is not None
    assert 0.05 < longer.tcp_rms_mm < 0.4
    assert 0.0 < longer.tcp_sigma_mm < 0.3


def with_models(folder: Path, *a4_mm: float) -> list[Path]:
    """Runs of one robot, a month apart, whose models differ by the length a4."""
    for month, value in enumerate(a4_mm, 1):
        run_in(folder, f"run-{month}", f"2026-{month:02d}-10", "925185")
        model_with(a4=value).save(folder / f"run-{month}" / "model.json")
    return [folder / f"run-{month}" for month in range(1, len(a4_mm) + 1)]


def test_two_runs_show_what_differs_in_their_set_up_errors_and_models(tmp_path: Path) -> None:
    a, b = with_models(tmp_path, 0.0, 0.5)
    found = compare_runs(a, b)
    differing = {fact.name for fact in found.facts if not fact.same}
    assert differing == {"began"}
    assert [(each.name, each.difference) for each in found.figures][:2] == [("before, mean", 0.0), ("before, rms", 0.0)]
    assert found.models is not None
    assert found.models.parameters[0].name == "a4"
    assert found.notes == ()


def test_runs_of_other_robots_or_without_a_model_are_compared_as_far_as_they_can_be(tmp_path: Path) -> None:
    (a,) = with_models(tmp_path, 0.0)
    run_in(tmp_path, "other", "2026-05-01", "111111", procedure="tracker")
    found = compare_runs(a, tmp_path / "other")
    assert found.models is None
    assert found.why_not == "no model was identified in other"
    assert [note.partition(":")[0] for note in found.notes] == [
        "The robots are different",
        "The procedures are different",
    ]


def test_sigma_of_a_mean_error_is_from_the_scatter_of_its_n_errors(tmp_path: Path) -> None:
    figures = {"mean": 0.3, "rms": 0.5, "max": 1.0}
    source = SourceFile("sphere.yaml", "", "")
    for name in ("a", "b"):
        with Journal.create(tmp_path / name, lambda: 0) as journal:
            started = RunStarted(
                source, source, {}, 1, "lockstep", "me", "2026-01-01T00:00:00Z", "", {}, section=("held",)
            )
            journal.append(started)
            verdict = {"verdict": "better", "sentence": "", "before": figures, "after": figures}
            journal.append(Recorded("verdict", {**verdict, "held": {"n": 17, "before": figures, "after": figures}}))
    mean, rms, *_ = compare_runs(tmp_path / "a", tmp_path / "b").figures
    assert mean.sigma == pytest.approx(np.sqrt(2.0) * 0.4 / np.sqrt(16))
    assert (mean.significant, rms.sigma) == (False, None)


def test_a_parameter_that_grows_from_month_to_month_drifts_and_the_others_do_not(tmp_path: Path) -> None:
    with_models(tmp_path, 0.0, 0.11, 0.19, 0.32, 0.39)
    run_in(tmp_path, "other", "2026-03-10", "111111")
    drift = parameter_drift(tmp_path, run_rows(tmp_path), "925185")
    assert [each.run for each in drift.runs] == [f"run-{month}" for month in range(1, 6)]
    by_name = {each.name: each for each in drift.parameters}
    assert by_name["a4"].values == pytest.approx((0.0, 0.11, 0.19, 0.32, 0.39))
    assert by_name["a4"].slope == pytest.approx(0.1, rel=0.1)
    assert [name for name, each in by_name.items() if each.drifts] == ["a4"]
    assert not any(name.startswith(("base", "tool_x")) for name in by_name)
    (only,) = parameter_drift(tmp_path, run_rows(tmp_path), "925185", ["a4"]).parameters
    assert only.name == "a4"


def test_the_command_line_shows_one_run_against_another(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with_models(tmp_path, 0.0, 0.5)

    def cellctl(*words: str) -> int:
        return exit_codes.exit_code_of(lambda: app(["show", *words, "--runs", str(tmp_path)], standalone_mode=False))

    assert cellctl("run-1", "--against", "run-2", "--json", str(tmp_path / "found.json")) == 0
    assert "a4" in capsys.readouterr().out
    assert json.loads((tmp_path / "found.json").read_text())["models"]["parameters"][0]["name"] == "a4"
    assert cellctl("run-1", "--against", "run-7") == 2
    assert "run-7" in capsys.readouterr().err
