"""Model files: an identified robot, its covariance, measured region and provenance, checked. Canonical JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from cellctl.calibration import (
    DEFLECTION,
    At,
    Estimate,
    FitResult,
    Frame,
    Identification,
    Kind,
    MeasuredRegion,
    Prediction,
    RobotModel,
    Task,
    effect_of,
    plane_estimates,
    prediction_sigma,
    settings_of,
)
from cellctl.calibration import Parameter as CalibrationParameter
from cellctl.calibration.model.residual_model import PostureBasis
from cellctl.calibration.problem.measured_region import OUTSIDE, Coverage, radius_95
from cellctl.files import InputError, Problem, canonical_json, sha256_of, write_atomically
from cellctl.files.validated import content_problems, read_json
from cellctl.formats._joint_box import JointBox
from cellctl.formats.load import LoadRegion
from cellctl.formats.measurements import Measurements, nominal_model
from cellctl.kinematics import Bools, Floats, JointMap
from cellctl.robot_file import Number, RobotFile

GREATEST = 1e9
"""No parameter, and no σ, is greater than this, in any unit."""

Row = Annotated[list[Number], Field(min_length=4, max_length=4)]
Matrix = Annotated[list[Row], Field(min_length=4, max_length=4)]
_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)

FORMAT: Literal["cellctl model 1"] = "cellctl model 1"

REGION_MARGIN_MM = 20.0
"""The same of a prismatic joint."""

REGION_MARGIN_DEG = 2.0
"""A reading this far outside those of the fit still counts as inside."""

_CURE = "give a file that `cellctl fit --out` wrote"


@final
class Parameter(BaseModel):
    """One parameter's deviation from nominal (or, of base and tool, from `start`), its σ after and before the data."""

    model_config = _STRICT
    name: str
    unit: str
    value: Number
    sigma: Number
    prior_sigma: Number


@final
class Centre(BaseModel):
    """Identified place of a sphere, a socket or an anchor, mm, in the measuring frame."""

    model_config = _STRICT
    id: str
    xyz: list[Number]
    sigma: list[Number]


@final
class TouchedPlane(BaseModel):
    """Identified plane, in the measuring frame: normal · x = offset, the touching tool on the normal's side; mm. sigma:
    1 σ of its place along the normal in the middle of its touches, mm; tilt_sigma: of the normal, deg, over both tilts.
    """

    model_config = _STRICT
    id: str
    normal: list[Number]
    offset: Number
    sigma: Number
    tilt_sigma: Number


@final
class LengthZero(BaseModel):
    """Reading at length 0 of an instrument with unknown zero, mm."""

    model_config = _STRICT
    id: str
    mm: Number
    sigma: Number


@final
class SessionPlace(BaseModel):
    """A session: its own groups, and its identified base and tool (4, 4), mm.

    covariance: of this session's parameters, about these; None for the first session, and in files that hold only the
    first one's.
    """

    model_config = _STRICT
    name: str
    own: list[str]
    base: Matrix
    tool: Matrix
    covariance: list[list[Number]] | None = None


@final
class JointRegion(BaseModel):
    """Least and greatest controller reading of each joint among the rows of the fit, deg (mm of a prismatic joint).

    postures: readings, deg, spread over those of the fit, with the distance (length, deg) at which two of them share 60
    % of a smooth error: these give how far outside other postures are. None in older files. within: the share of such
    an error that the rows of the fit leave open at one of them that is left out.
    """

    model_config = _STRICT
    min: list[Number]
    max: list[Number]
    postures: list[list[Number]] | None = None
    length: Annotated[Number, Field(gt=0.0)] | None = None
    within: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0

    @classmethod
    def of(cls, region: MeasuredRegion, joints: JointMap) -> JointRegion:
        """A measured region, in model angles, as readings."""
        both = joints.readings(np.stack([region.lower, region.upper]))
        basis = region.coverage if isinstance(region.coverage, PostureBasis) else None
        return cls(
            min=both.min(axis=0).tolist(),
            max=both.max(axis=0).tolist(),
            postures=joints.readings(basis.centres).tolist() if basis else None,
            length=float(np.rad2deg(basis.length_rad)) if basis else None,
            within=region.within,
        )

    def bounds(self, joints: JointMap) -> tuple[Floats, Floats]:
        """Least and greatest model angles (n,), rad."""
        both = joints.model(np.array([self.min, self.max]))
        return both.min(axis=0), both.max(axis=0)

    def coverage(self, joints: JointMap) -> Coverage:
        """Remaining variance at other postures, in model angles."""
        if self.postures and self.length:
            return PostureBasis(joints.model(np.array(self.postures)), float(np.deg2rad(self.length)))
        return JointBox(*self.bounds(joints))

    def inside(self, readings: Floats, joints: JointMap) -> Bools:
        """Which readings (N, n), deg or mm, lie in the region (N,)."""
        margins = [REGION_MARGIN_MM if unit == "mm" else REGION_MARGIN_DEG for unit in joints.units]
        return np.asarray((self._beyond(readings) <= margins).all(axis=1))

    def _beyond(self, readings: Floats) -> Floats:
        return np.asarray(np.maximum(np.maximum(np.array(self.min) - readings, readings - np.array(self.max)), 0.0))


@final
class ModelFile(BaseModel):
    """An identified robot.

    robot: the nominal robot file. start: poses (4, 4) of base and tool from which their deviations count. effects: the
    non-geometric effects, with their settings (None in files with the tool's bending alone). parameters: in the first
    session. covariance: of `parameters`, in their order and units. centres: spheres, sockets and anchors. planes: those
    that were touched. datums: zeros of instruments that measured lengths. sessions: where there are several.
    load_region: payloads of the fit, where its rows state them.
    outside_mm: additional 1 σ, 3-D, of a prediction far outside the joint region; scatter_mm: of errors too fast for
    the model; model_error_scale: factor on all of it, with its degrees_of_freedom, null where they are infinite
    (`MeasuredRegion`). figures: the fit's own figures. provenance:
    SHA-256 of the inputs.
    """

    model_config = _STRICT
    format: Literal["cellctl model 1"] = FORMAT
    robot: RobotFile
    model: str
    start: dict[Literal["base", "tool"], Matrix]
    effects: list[dict[str, Any]] | None = None
    parameters: list[Parameter]
    covariance: list[list[Number]]
    centres: list[Centre] = []
    planes: list[TouchedPlane] = []
    datums: list[LengthZero] = []
    sessions: list[SessionPlace] = []
    joint_region: JointRegion
    load_region: Annotated[LoadRegion | None, Field(exclude_if=lambda region: region is None)] = None
    outside_mm: Number = 0.0
    scatter_mm: Number = 0.0
    model_error_scale: Annotated[Number, Field(ge=1.0, exclude_if=lambda scale: scale == 1.0)] = 1.0
    degrees_of_freedom: Annotated[Number | None, Field(gt=0.0, exclude_if=lambda freedom: freedom is None)] = None
    figures: dict[str, Any]
    provenance: dict[str, str]

    @field_validator("effects")
    @classmethod
    def _complete(cls, effects: list[dict[str, Any]] | None) -> list[dict[str, Any]] | None:
        """The settings of each effect, completed where an older file lacks some."""
        return None if effects is None else [settings_of(effect_of(settings)) for settings in effects]

    @classmethod
    def of(
        cls,
        robot: RobotFile,
        measured: Measurements,
        result: FitResult,
        provenance: dict[str, str] | None = None,
        prior: ModelFile | None = None,
    ) -> Self:
        """The model that a fit identified from `measured` rows; the robot's hash is added to `provenance`.

        prior: the model that it was updated from; its measured region grows only by rows that determined the
        robot's own parameters.
        """
        found = result.identification.identified
        unknowns, count = found.unknowns, found.unknowns.robot
        model = unknowns.start.model
        sigma, state = np.sqrt(np.diag(found.covariance)), found.state
        return cls(
            robot=robot,
            model=result.model,
            start={"base": model.chain.base.tolist(), "tool": model.chain.tool.tolist()},
            effects=[settings_of(effect) for effect in model.effects],
            parameters=_parameters(result.identification),
            covariance=found.covariance[:count, :count].tolist(),
            centres=_centres(measured.task, state.points, sigma[state.of_points].reshape(-1, 3)),
            planes=_planes(measured.task, found),
            datums=_datums(measured.task.datums, state.datums, sigma[state.datums_at :]),
            sessions=_sessions(measured, result.identification),
            joint_region=JointRegion.of(result.region, robot.joint_map()),
            load_region=_loads(measured, result, prior.load_region if prior else None),
            outside_mm=result.region.outside_mm,
            scatter_mm=result.region.scatter_mm,
            model_error_scale=result.region.model_error_scale,
            degrees_of_freedom=_finite(result.region.degrees_of_freedom),
            figures=result.summary(),
            provenance={"robot_sha256": sha256_of(robot.model_dump()), **(provenance or {})},
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a model file. Raises InputError where it is none."""
        content = read_json(path, "model file", _CURE)
        try:
            model = cls.model_validate(of_this_format(content, FORMAT))
            model.robot_model()
            check_sigmas(model.covariance, [parameter.sigma for parameter in model.parameters])
        except ValidationError as error:
            raise InputError(content_problems(error, path, "model file", _CURE)) from error
        except (ValueError, RecursionError) as error:
            raise InputError(Problem(str(path), 0, 0, f"is no model file: {error}", _CURE)) from error
        return model

    def text(self) -> str:
        """The file's content: the same model gives the same bytes."""
        return canonical_json(self.model_dump()) + "\n"

    def save(self, path: Path) -> None:
        """Write the file. Raises OSError."""
        write_atomically(path, self.text())

    def robot_model(self) -> RobotModel:
        """The identified robot. Raises ValueError where the parameters are not those of the robot."""
        nominal = self._nominal()
        if set(self.start) != {"base", "tool"}:
            raise ValueError("it does not say from where base and tool start")
        placed = nominal.on(np.array(self.start["base"]), np.array(self.start["tool"]))
        given = [(parameter.name, parameter.unit) for parameter in self.parameters]
        if given != [(parameter.name, parameter.unit.name) for parameter in placed.parameters]:
            raise ValueError("its parameters are not those of its robot")
        if np.shape(self.covariance) != (len(self.parameters),) * 2:
            raise ValueError("its covariance has another size than its parameters")
        self._check_region()
        if max([abs(parameter.value) for parameter in self.parameters], default=0.0) > GREATEST:
            raise ValueError("a parameter is beyond all measure")
        check_covariance(np.array(self.covariance))
        for session in self.sessions:
            nominal.on(np.array(session.base), np.array(session.tool))  # accepts only rigid motions
            self._check_session(session, placed.parameters)
        return placed.with_deviations([parameter.value for parameter in self.parameters])

    def _nominal(self) -> RobotModel:
        """The robot as in its file, with the model's effects; an older file has the tool's bending at most.

        Raises ValueError where the effects are not those of the robot.
        """
        if self.effects is None:
            bends = bool(self.parameters) and self.parameters[-1].name == DEFLECTION
            return nominal_model(self.robot, touched=bends)
        effects = tuple(effect_of(settings) for settings in self.effects)
        for effect in effects:
            if not effect.suits(self.robot.n):
                raise ValueError(f"its {effect.group} is not that of its robot")
        return nominal_model(self.robot).with_effects(effects)

    def _check_session(self, session: SessionPlace, parameters: Sequence[CalibrationParameter]) -> None:
        """Refuse a session's covariance that is invalid, or differs from the first session's in shared parameters."""
        if session.covariance is None:
            return
        if np.shape(session.covariance) != np.shape(self.covariance):
            raise ValueError(f"the covariance of session '{session.name}' has another size than its parameters")
        check_covariance(np.array(session.covariance))
        shared = np.flatnonzero([each.group not in session.own for each in parameters])
        first, here = (np.array(each)[np.ix_(shared, shared)] for each in (self.covariance, session.covariance))
        if not np.allclose(here, first, rtol=1e-6, atol=1e-9 * float(np.abs(first).max(initial=0.0))):
            raise ValueError(f"the covariance of session '{session.name}' does not go with that of the first")

    def _check_region(self) -> None:
        lower, upper = self.joint_region.min, self.joint_region.max
        if not len(lower) == len(upper) == self.robot.n:
            raise ValueError("its joint region is not that of its robot")
        if any(low > high for low, high in zip(lower, upper, strict=True)) or self.outside_mm < 0.0:
            raise ValueError("its joint region is upside down, or the doubt outside it below 0")
        check_postures(self.joint_region.postures, self.robot.n, "joint region")

    @property
    def frame_of_points(self) -> bool:
        """Whether the model's frame is that of its fixed points, as no instrument measured."""
        pairs = zip(self.robot_model().parameters, self.parameters, strict=True)
        known = any(stored.sigma > 0.0 for parameter, stored in pairs if parameter.group == "base")
        return bool(self.centres or self.planes) and not known

    def predict(self, readings: Floats, at: At | None = None, *, frame: Frame = "base") -> Prediction:
        """Tool poses and 1 σ (see `sigma`) at controller readings (N, n), deg; `at`: the same with their conditions."""
        postures = self.robot.joint_map().model(readings) if at is None else at
        return Prediction(self.robot_model().pose(postures), self.sigma(readings, at, frame=frame))

    def sigma(
        self, readings: Floats, at: At | None = None, *, frame: Frame = "base", kind: Kind = "absolute"
    ) -> Floats:
        """1 σ (N,), 3-D, mm, of the TCPs predicted at controller readings (N, n), deg; `at`: with their conditions.

        frame: `base`, or `points` for the places relative to what was touched; the same where an instrument measured.
        kind: `absolute`, or `among` each other, without common rigid motions (ValueError for fewer than four). Outside
        the joint region σ is wider: one half-span outside the model is trusted no more than nominal.
        """
        postures = self.robot.joint_map().model(readings) if at is None else at
        chosen = frame if self.frame_of_points else "base"
        covariance = np.array(self.covariance)
        return prediction_sigma(
            self.robot_model(), covariance, postures, self.measured_region(), frame=chosen, kind=kind
        )

    def inside(self, readings: Floats) -> Bools:
        """Which readings (N, n), deg, lie in the measured region (N,), also that of its residual models; outside it the
        model extrapolates.
        """
        far = self._nominal().outside(self.robot.joint_map().model(readings)) > OUTSIDE
        return self.joint_region.inside(readings, self.robot.joint_map()) & ~far

    def measured_region(self) -> MeasuredRegion:
        """The measured region, in model angles."""
        joints, region, own = self.robot.joint_map(), self.joint_region, self._nominal().residual_models
        lower, upper = region.bounds(joints)
        coverage = region.coverage(joints)
        sizes = self.outside_mm, coverage, region.within, self.scatter_mm
        return MeasuredRegion(lower, upper, *sizes, own, self.model_error_scale, self.degrees_of_freedom or np.inf)

    @property
    def radius_95(self) -> float:
        """95 % radius of a predicted place over its σ, 3-D: 1.61, and more where σ has few degrees of freedom."""
        return radius_95(self.degrees_of_freedom or np.inf)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _loads(measured: Measurements, result: FitResult, prior: LoadRegion | None) -> LoadRegion | None:
    """Payloads of the rows of the fit; a prior model's grow by rows that determined the robot's own parameters."""
    if prior and not result.informed:
        return prior
    used = measured.task.rows.pick(list(result.identification.used))
    found = LoadRegion.of(block.postures for block in used.blocks)
    return found.joined(prior) if found else prior


def _parameters(found: Identification) -> list[Parameter]:
    unknowns, model = found.identified.unknowns, found.identified.state.model
    sigma = np.sqrt(np.diag(found.identified.covariance))
    before = np.where(unknowns.free, unknowns.sigma, 0.0)
    units = [parameter.unit.name for parameter in model.parameters]
    columns = (model.names, units, model.deviations.tolist(), sigma.tolist(), before.tolist())
    return [
        Parameter.model_validate(dict(zip(("name", "unit", "value", "sigma", "prior_sigma"), row, strict=True)))
        for row in zip(*columns, strict=False)
    ]


def _sessions(measured: Measurements, found: Identification) -> list[SessionPlace]:
    """Base and tool of the robot in each session; none where there is only one."""
    sessions = measured.task.sessions
    if len(sessions) < 2:
        return []
    state, covariance = found.identified.state, found.identified.covariance
    return [
        SessionPlace(
            name=session.name,
            own=sorted(session.own),
            base=model.chain.base_now.tolist(),
            tool=model.chain.tool_now.tolist(),
            covariance=covariance[columns][:, columns].tolist() if number else None,
        )
        for number, (session, model, columns) in enumerate(
            zip(sessions, state.models, state.columns, strict=True),
        )
    ]


def _centres(task: Task, centres: Floats, sigma: Floats) -> list[Centre]:
    rows = enumerate(zip(task.points, centres.tolist(), sigma.tolist(), strict=True))
    planes = task.planes
    return [Centre(id=name, xyz=place, sigma=spread) for at, (name, place, spread) in rows if at not in planes]


def _planes(task: Task, found: Estimate) -> list[TouchedPlane]:
    return [
        TouchedPlane(
            id=task.points[plane.point],
            normal=plane.normal.tolist(),
            offset=plane.offset_mm,
            sigma=plane.sigma_mm,
            tilt_sigma=plane.tilt_sigma_deg,
        )
        for plane in plane_estimates(task, found)
    ]


def _datums(names: tuple[str, ...], values: Floats, sigma: Floats) -> list[LengthZero]:
    rows = zip(names, values.tolist(), sigma.tolist(), strict=True)
    return [LengthZero(id=name, mm=value, sigma=spread) for name, value, spread in rows]


def of_this_format(content: Any, ours: str) -> Any:
    """`content` of a file, where it states the format `ours`."""
    theirs = content.get("format") if isinstance(content, dict) else None
    if not isinstance(theirs, str) or not theirs.startswith(ours.rstrip("0123456789")):
        raise ValueError(f'it does not say "format": "{ours}"')
    if theirs != ours:
        raise ValueError(
            f"it is of format '{theirs}', and this cellctl reads '{ours}': give it to the one that wrote it"
        )
    return content


def check_postures(postures: Sequence[Sequence[float]] | None, joints: int, what: str) -> None:
    """Refuse postures (M, n), if any, with another number of joints than the robot; what: their name in the error."""
    if any(len(posture) != joints for posture in postures or ()):
        raise ValueError(f"the postures of its {what} are not those of its robot")


def check_covariance(covariance: Floats) -> None:
    """Refuse a covariance (P, P) that is not symmetric, or has a variance below 0 along any combination."""
    variances = np.diag(covariance)
    scale = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    scaled = covariance / scale / scale[:, None]
    symmetric = np.isfinite(scaled).all() and np.allclose(scaled, scaled.T, atol=1e-6)
    if not symmetric or (variances < 0.0).any() or (variances > GREATEST**2).any():
        raise ValueError("its covariance is none: not symmetric, or a variance below 0")
    if len(scaled) and np.linalg.eigvalsh(scaled).min() < -1e-6:
        raise ValueError("its covariance is none: some combination of parameters has a variance below 0")


def check_sigmas(covariance: Sequence[Sequence[float]], sigmas: Sequence[float]) -> None:
    """Refuse σ (P,) of the parameters that are not those of their covariance (P, P)."""
    variances = [row[place] for place, row in enumerate(covariance)]
    pairs = zip(sigmas, variances, strict=True)
    if not all(math.isclose(sigma, math.sqrt(variance), rel_tol=1e-6) for sigma, variance in pairs):
        raise ValueError("its covariance does not go with the σ of its parameters")
