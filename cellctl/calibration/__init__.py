"""Identification: models, measurements, priors, the estimator, unobservable parameters, the verdict. Pure: arrays only.

`identify(task, rows)` fits; `fit(task, split)` fits and proves it on held-out rows.
"""

from cellctl.calibration.distributions import chi2_ppf
from cellctl.calibration.effects import (
    DEFLECTION,
    DOWN,
    EFFECTS,
    STANDARD_GRAVITY,
    Backlash,
    Direction,
    Discrepancy,
    Effect,
    EffectInputs,
    Harmonics,
    JointCompliance,
    JointField,
    MotorTorsion,
    OnlineTerms,
    ThermalExpansion,
    ToolDeflection,
    functions,
    kinds,
)
from cellctl.calibration.effects.stored import effect_of, settings_of
from cellctl.calibration.identification.identify import Identification, certified_rows, identify
from cellctl.calibration.identification.ladder import Step
from cellctl.calibration.identification.moved import MOVED
from cellctl.calibration.identification.progress import Progress
from cellctl.calibration.model.parameter import Group, Parameter, Phrase, Unit
from cellctl.calibration.model.postures import At, Postures, varies
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State, Tolerances, Unknowns
from cellctl.calibration.observability.unobservable import OBSERVABLE_SIGMAS, Hidden, Observability, observability
from cellctl.calibration.prediction.predict import (
    REGION_POINTS,
    Frame,
    Kind,
    Prediction,
    gauge_fixed,
    predict,
    prediction_sigma,
    shape_columns,
    sigma_among,
    sigma_over_region,
)
from cellctl.calibration.prediction.touches import (
    Drift,
    LocatedSphere,
    PlaneEstimate,
    linear_drift,
    locate_sphere,
    plane_estimates,
)
from cellctl.calibration.problem.measured_region import MeasuredRegion
from cellctl.calibration.problem.registration import base_and_tool, rigid_fit
from cellctl.calibration.problem.task import Session, Task
from cellctl.calibration.rows import (
    Measured,
    PlaneRows,
    PoseRows,
    PositionRows,
    Rows,
    SocketRows,
    SpacingRows,
    TouchRows,
)
from cellctl.calibration.rows.fixed_points import sphere_centre
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.solver.estimate import Estimate, estimate
from cellctl.calibration.verdict.agreement import Agreement
from cellctl.calibration.verdict.comparison import ComparedModel, compared_models
from cellctl.calibration.verdict.fit import FitResult, fit
from cellctl.calibration.verdict.judgement import (
    Baseline,
    ErrorFigures,
    HeldOut,
    Judgement,
    Verdict,
    compared_errors,
    judge,
    paired_verdict,
    rows_for_better,
    verdict_sentence,
)
from cellctl.calibration.verdict.proof import Split, sigma_doubts

__all__ = [
    "DEFLECTION",
    "DOWN",
    "EFFECTS",
    "MOVED",
    "OBSERVABLE_SIGMAS",
    "REGION_POINTS",
    "STANDARD_GRAVITY",
    "Agreement",
    "At",
    "Backlash",
    "Baseline",
    "ComparedModel",
    "Direction",
    "Discrepancy",
    "Drift",
    "Effect",
    "EffectInputs",
    "ErrorFigures",
    "Estimate",
    "FitResult",
    "Frame",
    "Group",
    "Harmonics",
    "HeldOut",
    "Hidden",
    "Identification",
    "JointCompliance",
    "JointField",
    "Judgement",
    "Kind",
    "LocatedSphere",
    "Measured",
    "MeasuredRegion",
    "MotorTorsion",
    "Observability",
    "OnlineTerms",
    "Parameter",
    "Phrase",
    "PlaneEstimate",
    "PlaneRows",
    "PoseRows",
    "PositionRows",
    "Postures",
    "Prediction",
    "Progress",
    "RobotModel",
    "RowBlocks",
    "Rows",
    "Session",
    "SocketRows",
    "SpacingRows",
    "Split",
    "State",
    "Step",
    "Task",
    "ThermalExpansion",
    "Tolerances",
    "ToolDeflection",
    "TouchRows",
    "Unit",
    "Unknowns",
    "Verdict",
    "base_and_tool",
    "certified_rows",
    "chi2_ppf",
    "compared_errors",
    "compared_models",
    "effect_of",
    "estimate",
    "fit",
    "functions",
    "gauge_fixed",
    "identify",
    "judge",
    "kinds",
    "linear_drift",
    "locate_sphere",
    "observability",
    "paired_verdict",
    "plane_estimates",
    "predict",
    "prediction_sigma",
    "rigid_fit",
    "rows_for_better",
    "settings_of",
    "shape_columns",
    "sigma_among",
    "sigma_doubts",
    "sigma_over_region",
    "sphere_centre",
    "varies",
    "verdict_sentence",
]
