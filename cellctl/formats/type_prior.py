"""Prior files: what calibrated robots of one type tell of another one of it. Canonical JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self, final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cellctl.calibration import Effect, RobotModel, State, Unknowns, effect_of, functions, kinds, settings_of
from cellctl.calibration.model.parameter import FRAMES
from cellctl.calibration.random_effects import RandomEffects, of_rows_alone
from cellctl.calibration.rows.type_rows import TypePrior
from cellctl.files import InputError, Problem, canonical_json, sha256_of, write_atomically
from cellctl.files.validated import content_problems, read_json
from cellctl.formats._prior import differing_parts
from cellctl.formats.measurements import Measurements
from cellctl.formats.measurements._measured import tolerances_of
from cellctl.formats.model import ModelFile, check_covariance, check_sigmas, of_this_format
from cellctl.kinematics import Floats
from cellctl.robot_file import Number, RobotFile

FORMAT: Literal["cellctl prior of a type 1"] = "cellctl prior of a type 1"
_CURE = "give a file that `cellctl prior` wrote"
_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)

USED = "type_prior_sha256"
"""Key of a model's provenance: SHA-256 of the prior of its type."""


@final
class PriorRobot(BaseModel):
    """A robot that the prior was made from: its run or model file, serial (empty: not known), SHA-256 of model and
    rows.
    """

    model_config = _STRICT
    run: str
    serial: str
    model_sha256: str
    data_sha256: str


@final
class TypeParameter(BaseModel):
    """A parameter over the robots: mean deviation from nominal, 1 σ of a further robot about it, tolerance of the robot
    file.
    """

    model_config = _STRICT
    name: str
    unit: str
    mean: Number
    sigma: Number
    tolerance: Number


@final
class LeftOut(BaseModel):
    """A run that is not in the prior, and why."""

    model_config = _STRICT
    run: str
    why: str


@final
class TypePriorFile(BaseModel):
    """A prior of a type.

    robot: the nominal robot. effects: settings of the effects whose amounts are among `parameters`. covariance: of
    `parameters` of a further robot, in their order and units; it has the tails of `degrees_of_freedom`. common_factors:
    directions in which the robots differ together. gain_nats: by which the robots' rows are more probable than by the
    tolerances alone; supported: whether this is more than chance. robots: those it was made from.
    """

    model_config = _STRICT
    format: Literal["cellctl prior of a type 1"] = FORMAT
    robot: RobotFile
    effects: list[dict[str, Any]]
    parameters: list[TypeParameter] = Field(min_length=1)
    covariance: list[list[Number]]
    degrees_of_freedom: Number
    common_factors: int
    gain_nats: Number
    supported: bool
    robots: list[PriorRobot]
    left_out: list[LeftOut] = []

    @classmethod
    def of(cls, models: Mapping[str, ModelFile], left_out: Sequence[LeftOut] = ()) -> Self:
        """From one model of each robot, by the names of their runs. Raises ValueError for fewer than three robots, and
        for models of different types.
        """
        first = next(iter(models.values()), None)
        if first is None:
            raise ValueError("no robot is left")
        robot = first.robot
        for name, model in models.items():
            if differ := differing_parts(robot, model.robot):
                raise ValueError(
                    f"'{name}' is of another type: another {' and '.join(differ)} than '{next(iter(models))}'"
                )
        effects = _common_effects(list(models.values()))
        parameters = _parameters(robot, list(models.values()), effects)
        tolerances = np.array([tolerance for _, tolerance in parameters.values()])
        rows = [of_rows_alone(*_posterior(model, list(parameters)), tolerances) for model in models.values()]
        found = RandomEffects.of(*(np.stack(part) for part in zip(*rows, strict=True)))
        covariance = found.predicted * np.outer(tolerances, tolerances)
        return cls(
            robot=robot,
            effects=[settings_of(effect) for effect in effects],
            parameters=[
                TypeParameter(name=name, unit=unit, mean=mean, sigma=sigma, tolerance=tolerance)
                for (name, (unit, tolerance)), mean, sigma in zip(
                    parameters.items(),
                    (found.mean * tolerances).tolist(),
                    np.sqrt(np.diag(covariance)).tolist(),
                    strict=True,
                )
            ],
            covariance=covariance.tolist(),
            degrees_of_freedom=found.degrees_of_freedom,
            common_factors=found.factors,
            gain_nats=found.gain,
            supported=found.supported,
            robots=[_robot(name, model) for name, model in models.items()],
            left_out=list(left_out),
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a prior file. Raises InputError where it is none."""
        content = read_json(path, "prior file", _CURE)
        try:
            prior = cls.model_validate(of_this_format(content, FORMAT))
            if np.shape(prior.covariance) != (len(prior.parameters),) * 2:
                raise ValueError("its covariance has another size than its parameters")
            check_covariance(np.array(prior.covariance))
            check_sigmas(prior.covariance, [parameter.sigma for parameter in prior.parameters])
        except ValidationError as error:
            raise InputError(content_problems(error, path, "prior file", _CURE)) from error
        except (ValueError, RecursionError) as error:
            raise InputError(Problem(str(path), 0, 0, f"is no prior file: {error}", _CURE)) from error
        return prior

    def text(self) -> str:
        """The file's content: the same prior gives the same bytes."""
        return canonical_json(self.model_dump()) + "\n"

    def save(self, path: Path) -> None:
        """Write the file. Raises OSError."""
        write_atomically(path, self.text())

    def sentence(self) -> str:
        """The prior in a sentence."""
        inside = [each for each in self.parameters if each.sigma < each.tolerance]
        told = f"{len(self.robots)} robots of type '{self.robot.name}'"
        if not self.supported:
            return f"{told} have nothing in common that their rows show: a fit with this prior is hardly another one."
        mean = np.sqrt(np.mean([(each.mean / each.tolerance) ** 2 for each in inside]))
        sigma = np.sqrt(np.mean([(each.sigma / each.tolerance) ** 2 for each in inside]))
        return (
            f"{told}: of {len(inside)} of {len(self.parameters)} parameters the mean is {mean:.2f} and 1 σ of a "
            f"further robot {sigma:.2f} tolerances (RMS)."
        )

    def refuse_own(self, data_sha256: str, serial: str, file: str) -> None:
        """Raise InputError if the rows with this hash, or the robot with this serial, are in the prior."""
        for robot in self.robots:
            if data_sha256 == robot.data_sha256 or (serial and serial == robot.serial):
                named = f"robot {robot.serial}" if robot.serial else "this robot"
                what = f"was made with {named} itself ({robot.run}): its rows would count twice"
                cure = f"make the prior again without it: cellctl prior … --without {robot.serial or robot.run}"
                raise InputError(Problem(file, 0, 0, what, cure))

    def of_model(self, model: RobotModel, candidates: Sequence[Effect] = ()) -> TypePrior:
        """The prior for a model, and for the effects that may be added to it: without the amounts of effects whose
        settings are others than here.
        """
        here = {effect["kind"]: effect for effect in self.effects}
        amounts = {name.name for effect in map(effect_of, self.effects) for name in effect.parameters}
        there = (*model.effects, *candidates)
        same = {
            each.name for effect in there if here.get(effect.group) == settings_of(effect) for each in effect.parameters
        }
        kept = [at for at, each in enumerate(self.parameters) if each.name not in amounts or each.name in same]
        names = tuple(self.parameters[at].name for at in kept)
        return TypePrior(names, self._mean[kept], np.array(self.covariance)[np.ix_(kept, kept)])

    @property
    def _mean(self) -> Floats:
        return np.array([parameter.mean for parameter in self.parameters])


def with_type_prior(measured: Measurements, prior: TypePriorFile, file: str, serial: str = "") -> Measurements:
    """The same rows for a robot of the type of `prior`. file: names it in errors; serial: of the robot, if known.

    Raises InputError for a robot of another type, and where the prior was made with these rows or this robot.
    """
    if differ := differing_parts(prior.robot, measured.robot):
        what = f"is of type '{prior.robot.name}', with another {' and '.join(differ)} than '{measured.robot.name}' has"
        raise InputError(Problem(file, 0, 0, what, "give a prior of this robot's type, or fit without --prior-of-type"))
    prior.refuse_own(measured.data.sha256 or sha256_of(measured.data.text()), serial, file)
    task = measured.task
    return replace(measured, task=replace(task, type_prior=prior.of_model(task.model, task.candidates or ())))


def why_not(model: ModelFile) -> str:
    """Why a model cannot be in a prior; empty if it can."""
    if USED in model.provenance:
        return "it was fitted with a prior of the type, which would count again"
    if model.figures.get("prior"):
        return "it was updated from a prior model: its σ is not of its rows alone"
    if not any(each.prior_sigma > 0.0 and each.group not in FRAMES for each in _with_groups(model)):
        return "nothing of its robot was identified"
    return ""


@final
@dataclass(frozen=True, slots=True)
class _Grouped:
    name: str
    unit: str
    group: str
    prior_sigma: float


def _with_groups(model: ModelFile) -> list[_Grouped]:
    pairs = zip(model.robot_model().parameters, model.parameters, strict=True)
    return [_Grouped(each.name, stored.unit, each.group, stored.prior_sigma) for each, stored in pairs]


def _common_effects(models: Sequence[ModelFile]) -> tuple[Effect, ...]:
    """Effects of the arm with the same settings in all models that have them. Random functions and error maps are of a
    single robot, and an effect of a touching tool is of the tool.
    """
    found: dict[str, list[Effect]] = {}
    for model in models:
        for effect in model.robot_model().effects:
            found.setdefault(effect.group, []).append(effect)
    known = kinds()
    return tuple(
        each[0]
        for group, each in found.items()
        if group not in functions() and not known[group].of_touches and known[group].prior_scales is not None
        if all(settings_of(one) == settings_of(each[0]) for one in each)
    )


def _parameters(
    robot: RobotFile, models: Sequence[ModelFile], effects: Sequence[Effect]
) -> dict[str, tuple[str, float]]:
    """Unit and tolerance of each parameter of the arm that any model identified."""
    free = {each.name for model in models for each in _with_groups(model) if each.prior_sigma > 0.0}
    nominal = RobotModel(robot.chain(), tuple(effects))
    sigma = Unknowns.of(State.alone(nominal), (), tolerances_of(robot)).sigma.tolist()
    return {
        each.name: (each.unit.name, tolerance)
        for each, tolerance in zip(nominal.parameters, sigma, strict=True)
        if each.group not in FRAMES and each.name in free
    }


def _posterior(model: ModelFile, names: Sequence[str]) -> tuple[Floats, Floats, Floats]:
    """Values (P,), covariance (P, P) and prior σ (P,) of the parameters `names`; 0 for one that the model lacks."""
    own = {each.name: at for at, each in enumerate(model.parameters)}
    here = [at for at, name in enumerate(names) if name in own]
    there = [own[names[at]] for at in here]
    values, covariance, prior = np.zeros(len(names)), np.zeros((len(names),) * 2), np.zeros(len(names))
    values[here] = [model.parameters[at].value for at in there]
    prior[here] = [model.parameters[at].prior_sigma for at in there]
    covariance[np.ix_(here, here)] = np.array(model.covariance)[np.ix_(there, there)]
    return values, covariance, prior


def _robot(name: str, model: ModelFile) -> PriorRobot:
    of_run = model.provenance
    return PriorRobot(
        run=name,
        serial=of_run.get("robot_serial", ""),
        model_sha256=sha256_of(model.text()),
        data_sha256=of_run.get("data_sha256", ""),
    )
