"""The measurement of a stand-off: travel from arrival to contact along the normal, by the model under test."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from cellctl.formats import ModelFile
from cellctl.procedure import StepContext
from procedures.steps.contact_search import FoundContact
from procedures.steps.sphere.rows import StandOffRow
from procedures.steps.sphere.touch_plans import StandOffPlan

if TYPE_CHECKING:
    from cellctl.calibration import RobotModel
    from cellctl.kinematics import JointMap


def standoff_row(context: StepContext, target: StandOffPlan, found: FoundContact) -> StandOffRow:
    """The row that a stand-off records."""
    import numpy as np

    joints, models = _models(context.artefact("model.json"))
    tips = models[target.run].tcp(joints.model([found.start, found.joints]))
    travel = float((tips[0] - tips[1]) @ np.array(target.normal))
    return StandOffRow(
        number=target.number,
        run=target.run,
        row=target.row,
        sphere=target.sphere,
        nominal=tuple(target.nominal),
        commanded=tuple(target.commanded),
        at_target=tuple(found.start),
        at_contact=tuple(round(value, 6) for value in found.joints),
        normal=tuple(target.normal),
        travel_mm=travel,
        error_mm=travel - target.distance_mm,
        expected_mm=target.expected_mm,
        sigma_mm=target.sigma_mm,
        attempt=context.attempt,
        **found.row(),
    )


@lru_cache(maxsize=1)
def _models(file: Path) -> tuple[JointMap, dict[str, RobotModel]]:
    """Joint map, nominal and identified robot of a run's model, which is constant once written."""
    from cellctl.calibration import RobotModel
    from cellctl.formats.table_making import nominal_chain

    model = ModelFile.load(file)
    return model.robot.joint_map(), {"before": RobotModel(nominal_chain(model)), "after": model.robot_model()}
