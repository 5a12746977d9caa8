"""Registers the model of an earlier run to the instrument of this one, from poses that are not judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cellctl.calibration import fit
from cellctl.files import InputError, Problem, sha256_of
from cellctl.formats import ModelFile, RobotFile, fit_report, from_prior, measurements
from cellctl.kinematics import Floats, inverse_pose
from cellctl.procedure import StepContext
from procedures.steps.identified import Found, held_out_split, provenance
from procedures.steps.tracker.identification import fit_verdict, pose_data
from procedures.steps.tracker.rows import MODEL_FILE, ReadModelRow

_NOISE_SCALE = 4.0
"""From this noise scale on the model that was read is taken for that of another state of the robot."""


def registered_model(context: StepContext) -> Found:
    """The model that was read, in the instrument's frame of this run, and its verdict on the held-out poses.

    Only the base is found anew, from the poses of the set `fit`: the robot is as it was identified. Raises InputError
    if the poses scatter about the model far more than its σ and the instrument's allow.
    """
    from cellctl.report.fit import FitStory, identification_rows  # imports much: not on the engine's loop

    robot, read = RobotFile.load(context.robot_file), context.recorded(ReadModelRow)[-1]
    prior = ModelFile.load(context.artefact(MODEL_FILE))
    data, ambiguous = pose_data(context)
    measured = from_prior(measurements(robot, data, measure="position"), prior, ("base",), read.run)
    split = held_out_split(measured)
    result = fit(measured.task, split)
    _refuse_another_state(context, read, float(result.identification.noise[0]))
    report = fit_report(measured, result)
    source = {**provenance(context, data.text()), "prior_sha256": sha256_of(read.text), "prior_run": read.run}
    base = result.identification.identified.state.model.chain.base_now
    file = _moved(ModelFile.of(robot, measured, result, source, prior), prior, base)
    verdict = fit_verdict(context, measured, result, report, ambiguous)
    rows = tuple(identification_rows(FitStory.of(measured, result, split, report)))
    return Found(data.text(), file.text(), replace(verdict, model_from=read.run), rows)


def _refuse_another_state(context: StepContext, read: ReadModelRow, noise_scale: float) -> None:
    if noise_scale < _NOISE_SCALE:
        return
    what = (
        f"the poses scatter about the model of {read.run} {noise_scale:.0f} times more than its σ and the instrument's "
        "allow: robot, tool, load or reflector is not as it was when it was identified; no table was pushed"
    )
    cure = "identify the robot as it is now: run the procedure without a model, or `cellctl run tracker_calibration`"
    raise InputError(Problem(str(context.run_folder / MODEL_FILE), 0, 0, what, cure))


def _moved(found: ModelFile, prior: ModelFile, base: Floats) -> ModelFile:
    """`prior` moved as a whole, so that its base is at `base` (4, 4), with the covariance `found`.

    The nominal robot moves too: a target stays where the nominal robot was when the model was identified.
    """
    motion = base @ inverse_pose(prior.robot_model().chain.base_now)
    values = {parameter.name: parameter.value for parameter in prior.parameters}
    return found.model_copy(
        update={
            "start": {"base": (motion @ np.array(prior.start["base"])).tolist(), "tool": prior.start["tool"]},
            "parameters": [each.model_copy(update={"value": values[each.name]}) for each in found.parameters],
            "sessions": [],
            "model": prior.model,
        }
    )
