"""Judges the model from the touches by poses that a tracker measured, beside nominal and a model from these poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, ClassVar, final

import numpy as np

from cellctl.calibration import ErrorFigures, FitResult, RowBlocks, Split, State, Task, compared_errors, fit
from cellctl.formats import Measurements, ModelFile, RobotFile, from_prior, measurements
from cellctl.kinematics import Floats, inverse_pose
from cellctl.metrology import error_directions
from cellctl.procedure import NoInputs, StepContext, step
from cellctl.records import Figures, Row
from procedures.steps.identified import held_out_split, provenance
from procedures.steps.judged import Judged
from procedures.steps.sphere.rows import HeldOutFigures, SphereVerdict
from procedures.steps.tracker.identification import pose_data
from procedures.steps.tracker.rows import PoseRow

Vectors = tuple[tuple[float, ...], ...]


@final
@dataclass(frozen=True, kw_only=True)
class JudgedPosesRow(Row):
    """N held-out poses: readings (N, n), deg; place (N, 3) in the robot's base frame.

    nominal, touches, tracker (N, 3): measured place less that of the nominal robot, of the model from the touches, and
    of the model from the tracker's own poses, base frame.
    """

    KIND: ClassVar[str] = "judged poses"
    readings: Vectors
    place: Vectors
    nominal: Vectors
    touches: Vectors
    tracker: Vectors


@final
@dataclass(frozen=True, kw_only=True)
class DirectionFigures:
    """RMS of errors by direction in the base frame, mm, and their change of scale with 1 σ, ppm."""

    x: float
    y: float
    z: float
    radial: float
    tangential: float
    scale_ppm: float
    scale_sigma_ppm: float


@final
@dataclass(frozen=True, kw_only=True)
class JudgedModel:
    """Errors of a model at the held-out poses: figures, and by direction. predicted_rms: by the model's σ, with the
    tracker's; coverage_95: share of the poses in their predicted 95 % region. None: the model states no σ.
    """

    errors: Figures
    directions: DirectionFigures
    predicted_rms: float | None = None
    coverage_95: float | None = None


@final
@dataclass(frozen=True, kw_only=True)
class ByTrackerFigures:
    """The models at `n_test` held-out poses; station frame and reflector offset of each from the same `n_fit` poses."""

    n_fit: int
    n_test: int
    nominal: JudgedModel
    touches: JudgedModel
    tracker: JudgedModel


@final
@dataclass(frozen=True, kw_only=True)
class ByTrackerVerdict(SphereVerdict):
    """The verdict on held-out touches; with `by_tracker`, that of the tracker on the model from the touches.

    accuracy: profile of the instrument; noise_only: of its noise alone.
    """

    SECTION: ClassVar[tuple[str, ...]] = (*SphereVerdict.SECTION, "by_tracker", "accuracy", "noise_only")
    accuracy: str = ""
    noise_only: bool = False
    by_tracker: ByTrackerFigures | None = None


_BENDS = "deflection"
"""The group of the tool's bending: the reflectors are fixed to the flange and do not move with it."""


@step("by_tracker.judge", verdict=ByTrackerVerdict)
async def judge(context: StepContext, inputs: NoInputs) -> Judged:
    """State how good the model from the touches is at held-out poses, beside nominal and a model from the poses."""
    found = await context.clock.compute(compared, context)
    await context.write_artefact("tracker.csv", found.data)
    await context.write_artefact("tracker_model.json", found.model)
    await context.record(found.poses)
    await context.record(found.verdict)
    return Judged.of(found.verdict)


@final
@dataclass(frozen=True)
class Compared:
    """The texts of the poses' data set and of the model from them, the errors at held-out poses, and the verdict."""

    data: str
    model: str
    poses: JudgedPosesRow
    verdict: ByTrackerVerdict


@final
@dataclass(frozen=True, eq=False)
class _Fits:
    """The poses, and the two fits to those of the set `fit`: of registration alone for the model from the touches, of
    a model of their own.
    """

    measured: Measurements
    touches: FitResult
    tracker: FitResult


def compared(context: StepContext) -> Compared:
    """Register all models alike on the poses of the set `fit`, compare them on the others. Raises InputError."""
    robot = RobotFile.load(context.robot_file)
    data, left_out = pose_data(context)
    measured = measurements(robot, data, measure="position")
    split = held_out_split(measured)
    model = ModelFile.load(context.artefact("model.json"))
    registered = _at_the_flange(from_prior(measured, model, ("base", "tool")).task)
    fits = _Fits(measured, fit(registered, split), fit(measured.task, split))
    poses = _judged_poses(fits, split)
    return Compared(
        data=data.text(),
        model=ModelFile.of(robot, measured, fits.tracker, provenance(context, data.text())).text(),
        poses=poses,
        verdict=_verdict(context, fits, split, poses, left_out),
    )


def _at_the_flange(task: Task) -> Task:
    """The task with a prior model, without the tool's bending."""
    model = task.model
    kept = np.array([each.group != _BENDS for each in model.parameters])
    of_chain = len(model.chain.parameters)
    stiff = replace(
        model,
        effects=tuple(effect for effect in model.effects if effect.group != _BENDS),
        amounts=model.deviations[of_chain:][kept[of_chain:]],
    )
    assert task.prior is not None
    return replace(task, model=stiff, prior=task.prior[np.ix_(kept, kept)])


def _judged_poses(fits: _Fits, split: Split) -> JudgedPosesRow:
    held_out = _held_out(split)
    rows = fits.measured.task.rows.pick(held_out)
    touches = fits.touches.identification.identified.state
    nominal, tracker = (
        each.state for each in (fits.tracker.identification.nominal, fits.tracker.identification.identified)
    )
    return JudgedPosesRow(
        readings=_tuples(fits.measured.readings[held_out]),
        place=_tuples(_places(touches, rows)),
        nominal=_tuples(_errors(nominal, rows)),
        touches=_tuples(_errors(touches, rows)),
        tracker=_tuples(_errors(tracker, rows)),
    )


def _held_out(split: Split) -> Any:
    """Indices of the held-out rows."""
    return np.concatenate([np.asarray(test, int) for _, test in split.judged])


def _registration(touches: FitResult, rows: RowBlocks) -> Floats:
    """How the places (N, 3, R) of `rows` follow station frame and reflector offset, in the robot's base frame."""
    found = touches.identification.identified
    parts = []
    for block in rows.blocks:
        model = found.state.models[block.session]
        columns = found.state.spread(model.jacobian(block.q)[:, :3], block.session)
        parts.append(model.chain.base_now[:3, :3].T @ columns[..., found.unknowns.free])
    return np.concatenate(parts)


def _errors(state: State, rows: RowBlocks) -> Floats:
    """Measured less predicted place (N, 3), mm, in the robot's base frame."""
    return np.concatenate(
        [-block.deviation(state) @ state.models[block.session].chain.base_now[:3, :3] for block in rows.blocks]
    )


def _places(state: State, rows: RowBlocks) -> Floats:
    """Measured places (N, 3), mm, in the robot's base frame."""
    parts = []
    for block in rows.blocks:
        to_base, measured = inverse_pose(state.models[block.session].chain.base_now), block.positions
        assert measured is not None
        parts.append(measured @ to_base[:3, :3].T + to_base[:3, 3])
    return np.concatenate(parts)


def _tuples(values: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in values.round(6).tolist())


def _verdict(context: StepContext, fits: _Fits, split: Split, poses: JudgedPosesRow, left_out: int) -> ByTrackerVerdict:
    touched, points = context.recorded(SphereVerdict)[-1], [row.point for row in context.recorded(PoseRow)]
    columns = _registration(fits.touches, fits.measured.task.rows.pick(_held_out(split)))
    figures = ByTrackerFigures(
        n_fit=fits.tracker.n_fit,
        n_test=fits.touches.n_test,
        nominal=_judged(poses, poses.nominal, columns),
        touches=_judged(poses, poses.touches, columns, fits.touches),
        tracker=_judged(poses, poses.tracker, columns, fits.tracker),
    )
    decided = {
        "verdict": fits.touches.verdict,
        "sentence": _sentence(figures, fits.touches),
        "before": figures.nominal.errors,
        "after": figures.touches.errors,
        "lines": tuple(_lines(figures, touched, points[0].accuracy, left_out, noise_only=points[0].noise_only)),
        "held_out": HeldOutFigures(touched.verdict, touched.before, touched.after),
        "by_tracker": figures,
        "accuracy": points[0].accuracy,
        "noise_only": points[0].noise_only,
    }
    return ByTrackerVerdict(**{field.name: getattr(touched, field.name) for field in fields(touched)} | decided)


def _judged(
    poses: JudgedPosesRow, errors: Sequence[Sequence[float]], registration: Floats, by: FitResult | None = None
) -> JudgedModel:
    vectors = np.array(errors)
    return JudgedModel(
        errors=Figures(**asdict(ErrorFigures.of(np.linalg.norm(vectors, axis=1)))),
        directions=DirectionFigures(**asdict(error_directions(np.array(poses.place), vectors, registration))),
        predicted_rms=by.predicted_test_rms if by else None,
        coverage_95=by.coverage_95 if by else None,
    )


def _sentence(figures: ByTrackerFigures, touches: FitResult) -> str:
    names = ("by the nominal robot", "by the model from the touches", "by a model from the tracker's own poses")
    models = (figures.nominal, figures.touches, figures.tracker)
    errors = [ErrorFigures(*(value or 0.0 for value in asdict(each.errors).values())) for each in models]
    ends = {
        "better": "The model from the touches is better than nominal.",
        "worse": "The model from the touches is worse than nominal: do not use it.",
    }
    end = ends.get(touches.verdict, f"The model from the touches is no better than nominal: {touches.verdict_reason}.")
    return f"Position error at held-out poses, by the tracker: {compared_errors(names, errors, figures.n_test)}. {end}"


def _lines(
    figures: ByTrackerFigures, touched: SphereVerdict, accuracy: str, left_out: int, *, noise_only: bool
) -> list[str]:
    """Lines below the verdict: σ, directions, held-out touches, the instrument."""
    model, along = figures.touches, figures.touches.directions
    share = 100.0 * (model.coverage_95 or 0.0)
    profile = " (the noise of such an instrument only, not its behaviour)" if noise_only else ""
    lines = [
        f"Model from the touches: {model.predicted_rms:.3f} mm RMS predicted, {model.errors.rms:.3f} mm found; "
        f"{share:.0f} % of the poses lie in their 95 % region.",
        f"Its errors by direction: {along.radial:.3f} mm radial, {along.tangential:.3f} mm tangential, {along.z:.3f} "
        f"mm vertical (RMS); scale {along.scale_ppm:+.0f} ± {along.scale_sigma_ppm:.0f} ppm (1 σ).",
        touched.sentence,
        f"Instrument: accuracy profile {accuracy}{profile}. Nothing was pushed to the controller.",
    ]
    if left_out:
        lines.append(f"{left_out} poses were measured while the station moved; they were left out.")
    return lines
