"""Whether two model files of one robot agree, by their own covariances."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cellctl.calibration.verdict.agreement import Agreement, Calibration, agreement
from cellctl.files import sha256_of
from cellctl.formats import ModelFile
from cellctl.formats.type_prior import USED
from cellctl.kinematics import Floats
from cellctl.operations.comparing_models import incomparable

DATA = "dataset.csv"

PLACES_AT_LEAST = 20
"""With fewer places in the region that both measured, a share of 90 % has no meaning."""


def models_agree(a: ModelFile, b: ModelFile) -> Agreement:
    """Compare two models at the postures that either measured, as far as they lie in the joint region of both.

    Raises ValueError with the reason if they cannot be compared, or if their errors are correlated.
    """
    if why := incomparable(a, b) or _dependent(a, b) or _dependent(b, a):
        raise ValueError(why)
    readings = _common_readings(a, b)
    if len(readings) < PLACES_AT_LEAST:
        raise ValueError(f"only {len(readings)} measured postures are in the joint region of both")
    q = a.robot.joint_map().model(readings)
    return agreement(_calibration(a), _calibration(b), q, a.robot.chain().tool)


def shared_rows(a: Path, b: Path) -> int:
    """Number of rows that two data sets have in common; 0 where either cannot be read."""
    try:
        first, second = (set(each.read_text(encoding="utf-8").splitlines()[1:]) for each in (a, b))
    except OSError:
        return 0
    return len(first & second)


def _dependent(a: ModelFile, b: ModelFile) -> str:
    """Why the errors of two models are correlated beyond their common tolerances; empty if they are not."""
    own, others = a.provenance, b.provenance
    serials = own.get("robot_serial", ""), others.get("robot_serial", "")
    if all(serials) and serials[0] != serials[1]:
        return f"they are of different robots, {serials[0]} and {serials[1]}"
    if own.get("data_sha256") and own.get("data_sha256") == others.get("data_sha256"):
        return "they are from the same rows"
    if others.get("prior_sha256") == sha256_of(a.text()):
        return "one was updated from the other"
    if own.get("prior_sha256") and own.get("prior_sha256") == others.get("prior_sha256"):
        return "both were updated from the same prior model"
    if USED in own and USED in others:
        return "both were fitted with a prior of the type, which they would agree by"
    return ""


def _common_readings(a: ModelFile, b: ModelFile) -> Floats:
    """Measured readings (N, n), deg, of either that are in the region of both."""
    stored = [np.array(each.joint_region.postures or np.zeros((0, a.robot.n))) for each in (a, b)]
    readings = np.concatenate(stored)
    return np.asarray(readings[a.inside(readings) & b.inside(readings)])


def _calibration(model: ModelFile) -> Calibration:
    prior = np.array([parameter.prior_sigma for parameter in model.parameters])
    return Calibration(model.robot_model(), np.array(model.covariance), prior**2)
