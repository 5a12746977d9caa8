"""Predictions for rows: the elbow arm in closed form, with errors, σ and conditions that the test chooses."""

from __future__ import annotations

import csv
import io
from typing import Any

import numpy as np
import pytest

from cellctl.calibration.effects import ThermalExpansion
from cellctl.files import InputError, parse_yaml
from cellctl.formats import DataSet, ModelFile, RobotFile, nominal_model
from cellctl.formats.model import JointRegion
from cellctl.operations.predicting import predict_rows
from tests.helpers.arms import ELBOW_LOWER, ELBOW_ROBOT, ELBOW_UPPER, ElbowArm, Floats, drawn, model_of

ROBOT = RobotFile.from_document(parse_yaml(ELBOW_ROBOT, "robot.yaml"))
ERRORS = {"a2": 0.8, "a3": -0.7, "theta3": np.radians(0.03)}
ARM = ElbowArm(at=(0.0, 0.0, 0.0))
"""With these errors, at the origin."""
REGION = np.array([ELBOW_LOWER, ELBOW_UPPER])
READINGS = drawn(np.random.default_rng(5), 6)


def model(values: dict[str, float] | None = None, sigma: dict[str, float] | None = None, **other: Any) -> ModelFile:
    """The elbow arm at the origin without a tool; sigma: of parameters (mm, rad) that are not certain."""
    made = model_of(ROBOT, ERRORS if values is None else values, other.pop("effects", ()), REGION)
    variances = [(sigma or {}).get(each.name, 0.0) ** 2 for each in made.parameters]
    start = dict.fromkeys(("base", "tool"), np.eye(4).tolist())
    return made.model_copy(update={"start": start, "covariance": np.diag(variances).tolist(), **other})


def rows(readings: Floats, letter: str = "A", **columns: Any) -> DataSet:
    names = [f"{letter}{joint}" for joint in (1, 2, 3)]
    joints = [dict(zip(names, row, strict=True)) for row in readings.tolist()]
    return DataSet.of_records(
        [row | {name: values[at] for name, values in columns.items()} for at, row in enumerate(joints)], "joints.csv"
    )


def test_the_tcp_is_that_of_the_arm_with_its_errors_also_from_radians() -> None:
    for data in (rows(READINGS), rows(np.radians(READINGS), "q")):
        found = predict_rows(model(), data)
        assert found.poses[:, :3, 3] == pytest.approx(ARM.tcp(READINGS), abs=1e-9)
        assert found.readings == pytest.approx(READINGS, abs=1e-12)


def test_the_csv_has_kuka_angles_of_the_forearm_and_every_column_of_the_reference() -> None:
    readings = np.array([[30.0, -40.0, -60.0], [-70.0, -60.0, -40.0]])
    found = list(csv.DictReader(io.StringIO(predict_rows(model({}), rows(readings)).text())))
    assert list(found[0]) == [*["A1", "A2", "A3", "X", "Y", "Z", "A", "B", "C", "sigma", "sigma_among", "seen"]]
    elbow = 10.0 - readings[:, 1] + readings[:, 2]  # the forearm above the horizontal, and the joint's axis is its z
    for row, turn, up in zip(found, readings[:, 0], elbow, strict=True):
        assert [float(row[name]) for name in "ABC"] == pytest.approx([turn, -up, 90.0], abs=1e-9)
    assert [row["sigma_among"] for row in found] == ["", ""], "fewer than four rows have no shape"


def test_sigma_is_the_lever_of_an_uncertain_joint_zero() -> None:
    sigma = 2e-4
    turned = predict_rows(model(sigma={"theta1": sigma}), rows(READINGS))
    place = ARM.tcp(READINGS)
    assert turned.sigma_mm == pytest.approx(sigma * np.hypot(place[:, 0], place[:, 1]), rel=1e-6)
    assert turned.sigma_among_mm == pytest.approx(np.zeros(6), abs=1e-6), "it turns all places together"
    bent = predict_rows(model(sigma={"theta3": sigma}), rows(READINGS))
    assert bent.sigma_mm == pytest.approx(np.full(6, sigma * ARM.fore), rel=1e-6)
    assert bent.sigma_among_mm is not None
    assert (bent.sigma_among_mm > 0.01).all(), "which changes the places among themselves"


def test_a_row_outside_the_measured_region_is_told_and_less_certain() -> None:
    turns = np.array([0.0, 91.5, 93.0, -135.0, 180.0])
    readings = np.column_stack([turns, np.full(5, -40.0), np.full(5, -60.0)])
    found = predict_rows(model(outside_mm=3.0), rows(readings))
    assert found.inside.tolist() == [True, True, False, False, False], "2° beyond the region still count as inside"
    shares = np.array([0.0, 0.0, 3.0, 45.0, 90.0]) / 90.0  # of half the region's span beyond it
    assert found.sigma_mm == pytest.approx(3.0 * shares**2, rel=1e-6)
    assert [row["seen"] for row in found.records()] == [1, 1, 0, 0, 0]


def test_links_expand_with_the_rows_temperature_and_are_said_to_be_at_20_degrees_without_it() -> None:
    effect = ThermalExpansion.of(nominal_model(ROBOT).chain)
    per_kelvin = 2e-5
    warm = model(ERRORS | {each.name: per_kelvin for each in effect.parameters}, effects=(effect,))
    celsius = np.array([20.0, 25.0, 30.0, 35.0, 15.0, 40.0])
    found = predict_rows(warm, rows(READINGS, temperature=celsius.tolist()))
    nominal = ElbowArm(upper=500.0, fore=450.0, zero_deg=0.03, at=(0.0, 0.0, 0.0))
    grown = ElbowArm(upper=500.0, fore=450.0, zero_deg=0.03, at=(0.0, 0.0, 0.0), growth=per_kelvin)
    growth = grown.tcp(READINGS, celsius) - nominal.tcp(READINGS)
    assert found.poses[:, :3, 3] == pytest.approx(ARM.tcp(READINGS) + growth, abs=1e-3)  # the errors expand too
    assert found.assumed == ()
    without = predict_rows(warm, rows(READINGS))
    assert without.assumed == ("no column temperature: predicted for 20 °C",)
    assert without.poses[:, :3, 3] == pytest.approx(ARM.tcp(READINGS), abs=1e-9)


def test_every_row_that_cannot_be_used_is_named_by_its_line() -> None:
    data = DataSet.parse("A1,A2,A3\n1,-20,-60\n1,x,-60\n1,,-60\n190,-20,-60\n1,-20\n", "joints.csv")
    with pytest.raises(InputError) as caught:
        predict_rows(model(), data)
    assert [problem.line for problem in caught.value.problems] == [3, 4, 5, 6]
    assert {problem.file for problem in caught.value.problems} == {"joints.csv"}


def test_radians_in_columns_of_degrees_are_refused_only_where_all_rows_fit_as_radians() -> None:
    near = np.array([[0.0, -40.0, -60.0], [30.0, -45.0, -70.0]])
    with pytest.raises(InputError, match="A1…A3 are radians") as caught:
        predict_rows(model(), rows(np.radians(near)))
    assert "name the columns q1…q3" in caught.value.problems[0].cure
    mixed = np.vstack([np.radians(near), [[170.0, 0.0, 0.0]]])
    assert not predict_rows(model(), rows(mixed)).inside.any()
    wide = model(joint_region=JointRegion(min=[3.0] * 3, max=[170.0] * 3))  # as radians both of these are inside too
    assert predict_rows(wide, rows(np.array([[0.5] * 3, [2.0] * 3]))).inside.tolist() == [False, True]
