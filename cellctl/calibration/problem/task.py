"""The task of an identification: rows, free parameters, priors, and start values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.model.effect import Effect
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import GEOMETRY, PLACED, State, Tolerances, Unknowns
from cellctl.calibration.problem.measured_region import MeasuredRegion
from cellctl.calibration.problem.registration import fixed_points, on_instrument, with_datums
from cellctl.calibration.rows import Measured, SpacingRows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.rows.type_rows import TypePrior, TypeRows
from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, slots=True)
class Session:
    """Measurements with one set-up. own: which of base and tool belong to this session alone."""

    name: str = ""
    own: frozenset[Group] = frozenset()


@final
@dataclass(frozen=True, eq=False)
class Task:
    """Inputs of an identification.

    model: nominal robot, or a prior model. rows: everything measured, one block or several. points, rough: names of
    spheres, sockets and planes, and their rough places (S, 3), mm (of planes the poles; NaN where not known).
    datums: names of instruments that measure lengths from an unknown zero; datum_sigmas: prior 1 σ of these zeros
    about 0, mm; none: flat. spacings: certified distances, or None. groups: what may change besides what registers the
    robot to the measurement; None: geometry, tool, and all effects that the model has.
    sessions: by the blocks' numbers; the first always has its own base and tool.

    prior (P, P): covariance of the model's own parameters where a prior model is updated. With it and no `groups`,
    everything is free within that model's uncertainty, or beyond it where the rows are evidence that the robot has
    changed since; base and tool of an instrument's rows are found anew. With `groups` these alone are free, with a flat
    prior (a crash, a new motor, a new tool), and the rest is held, with its uncertainty.
    nominal: the robot as in its file, where `model` is a prior model: the baseline for the identified robot; None:
    `model` itself. region: where the prior model was measured; None: unknown.

    type_prior: what robots of the same type tell of the model's parameters, besides the tolerances; or None.
    candidates: effects that may be added to the model, in this order, as far as the rows support them (`ladder`); None:
    the model's terms are fixed.
    """

    model: RobotModel
    rows: RowBlocks
    points: tuple[str, ...] = ()
    rough: Floats | None = None
    spacings: SpacingRows | None = None
    groups: frozenset[Group] | None = None
    tolerances: Tolerances = field(default_factory=Tolerances)
    sessions: tuple[Session, ...] = (Session(),)
    prior: Floats | None = None
    candidates: tuple[Effect, ...] | None = None
    datums: tuple[str, ...] = ()
    datum_sigmas: tuple[float, ...] = ()
    nominal: RobotModel | None = None
    region: MeasuredRegion | None = None
    type_prior: TypePrior | None = None

    def __post_init__(self) -> None:
        if self.prior is not None and self.candidates is not None:
            raise ValueError("a prior model is updated with its own terms: no terms are tried")
        object.__setattr__(self, "rows", RowBlocks.of(self.rows))

    @property
    def free_groups(self) -> frozenset[Group]:
        """Groups that may change besides the registration."""
        if self.groups is not None:
            return self.groups
        return frozenset({GEOMETRY, "tool", *(effect.group for effect in self.model.effects)})

    @property
    def is_partial_update(self) -> bool:
        """Whether a prior model is held except for a few groups."""
        return self.prior is not None and self.groups is not None

    @property
    def has_new_tool(self) -> bool:
        """Whether a prior model has a new tool, measured only by distances with known zeros.

        Tool and points are then multiplied with each other, and have local optima: `solver.tool_search`.
        """
        touched = all(block.distances is not None for block in self.rows.blocks if len(block)) and not self.datums
        return self.is_partial_update and "tool" in self.free_groups and touched

    @property
    def registered(self) -> frozenset[Group]:
        """Which of base and tool tie `model` to an instrument, with a flat prior.

        In partial work those that are free: a prior model is registered as the identified robot is.
        """
        return PLACED & self.free_groups if self.is_partial_update else PLACED

    @property
    def type_rows(self) -> TypeRows | None:
        """What the type tells of the parameters of this model."""
        return self.type_prior.rows(self.model, self.tolerances) if self.type_prior else None

    @property
    def of_nominal(self) -> Self:
        """The same rows for the robot as in its file, without a prior model."""
        return replace(self, model=self.nominal or self.model, groups=None, prior=None, nominal=None, region=None)

    @property
    def taught_mm(self) -> float:
        """1 σ of the place of the tool in the robot file; inf with a prior model, whose tool may be new."""
        return self.tolerances.tool_mm if self.prior is None else np.inf

    @property
    def registers_only(self) -> bool:
        """Whether only the registration to the measurement is free."""
        unknowns = self.unknowns(self._unplaced_state())
        return not bool((self.free_parameters(unknowns) & ~self.registration_parameters(unknowns)).any())

    @property
    def rows_at_least(self) -> int:
        """With fewer rows than this, registration alone explains everything."""
        return self.n_registration // int(self.rows.numbers.max(initial=1)) + 1

    @property
    def n_registration(self) -> int:
        """Count of numbers that registration finds: 3 for each point, 1 for each datum, 9 or 12 for base and tool in
        an instrument.
        """
        return max(int(np.count_nonzero(self.registration_parameters(self.unknowns(self._unplaced_state())))), 1)

    def with_effects(self, effects: tuple[Any, ...]) -> Self:
        """The same task for a model with these effects."""
        return replace(self, model=self.model.with_effects(effects))

    def unknowns(self, start: State) -> Unknowns:
        """All parameters about `start`, all free, with their priors."""
        names = [session.name for session in self.sessions[1:]]
        of = partial(Unknowns.of, start, self.points, self.tolerances, sessions=names, planes=self.planes)
        taught = of(datums=self.datums, datum_sigmas=self.datum_sigmas)
        flat = of(flat=PLACED, datums=self.datums, datum_sigmas=self.datum_sigmas)
        seen = self._seen_by(taught, lambda block: block.of_instrument)
        if self.prior is None:
            unknown = seen | taught.among(frozenset({"base"}))
            return replace(taught, sigma=np.where(unknown, flat.sigma, taught.sigma))
        return self._with_prior(taught, flat.sigma, seen)

    def registration_parameters(self, unknowns: Unknowns) -> Bools:
        """Which parameters (P,) tie nominal to the measurement: points and datums always, base and tool to an
        instrument.
        """
        instrument = self._seen_by(unknowns, lambda block: block.of_instrument)
        later = np.arange(len(unknowns.names)) >= unknowns.robot  # a later session's own is new to any prior model
        placed = (unknowns.among(self.registered) | later) & instrument & ~self._unturned(unknowns)
        return np.asarray(placed | unknowns.among(frozenset({"points", "datums"})))

    def free_parameters(self, unknowns: Unknowns) -> Bools:
        """Which parameters (P,) are identified, registration among them."""
        free = self.registration_parameters(unknowns) | (unknowns.among(self.free_groups) & ~self._unturned(unknowns))
        if self.prior is None or self.is_partial_update:
            return np.asarray(free)
        known = unknowns.prior
        assert known is not None
        return np.asarray(free & (np.diag(known) > 0.0))  # what the prior model held stays held

    def start(self, rows: RowBlocks) -> State:
        """Start of nominal, from the model and `rows` alone."""
        return self.fixed_by(self.placed(rows), rows)

    def identification_start(self, rows: RowBlocks) -> State:
        """Start of the identification, from the model and `rows` alone: base or tool that are new to a prior model are
        fitted to the rows.
        """
        return self.fixed_by(self.placed(rows, PLACED & self.free_groups), rows)

    def fixed_by(self, models: Sequence[RobotModel], rows: RowBlocks) -> State:
        """`models`, one for each session, with points at their rough places, or else where `rows` put them, and the
        zeros of lengths.
        """
        rough = np.full((len(self.points), 3), np.nan) if self.rough is None else self.rough
        own = [session.own for session in self.sessions[1:]]
        points = fixed_points(models, rows.blocks, rough)
        state = State.of_sessions(models, own, points, np.zeros(len(self.datums)))
        return with_datums(state, rows.blocks) if self.datums else state

    @property
    def planes(self) -> frozenset[int]:
        """Which of the points are planes."""
        touched = [block.visited for block in self.rows.blocks if block.of_planes]
        return frozenset(int(index) for indices in touched for index in np.unique(indices))

    def _unplaced_state(self) -> State:
        """A state of the right shape."""
        models = [self.model] * len(self.sessions)
        own = [session.own for session in self.sessions[1:]]
        return State.of_sessions(models, own, np.zeros((len(self.points), 3)), np.zeros(len(self.datums)))

    def _seen_by(self, unknowns: Unknowns, such: Callable[[Measured], bool]) -> Bools:
        """Which base and tool parameters (P,) act on `such` rows."""
        result = np.zeros(len(unknowns.names), bool)
        for session in {block.session for block in self.rows.blocks if len(block) and such(block)}:
            result[unknowns.start.columns[session]] = True
        return result & unknowns.among(PLACED)

    def _unturned(self, unknowns: Unknowns) -> Bools:
        """The tool's turns (P,) that no row measured: a point has no orientation."""
        turns = np.array([each.group == "tool" and each.turns for each in unknowns.parameters])
        return np.asarray(turns & ~self._seen_by(unknowns, lambda block: block.orientations is not None))

    def _with_prior(self, unknowns: Unknowns, flat: Floats, unknown: Bools) -> Unknowns:
        """These unknowns with a prior model's covariance, except those to be found anew."""
        assert self.prior is not None
        covariance = np.zeros((len(unknowns.names),) * 2)
        covariance[: unknowns.robot, : unknowns.robot] = self.prior
        anew = np.arange(len(unknowns.names)) >= unknowns.robot
        if self.is_partial_update:
            sigma = self._found_anew(unknowns, flat)
            anew |= unknowns.among(self.free_groups)
        else:
            sigma, anew = np.where(unknown, flat, unknowns.sigma), anew | unknown
        found = self.registration_parameters(unknowns) | (unknowns.among(self.free_groups) & ~self._unturned(unknowns))
        covariance[anew], covariance[:, anew] = 0.0, 0.0
        covariance[anew, anew] = np.where(found, sigma**2, 0.0)[anew]  # the others are exactly as stated
        return replace(unknowns, sigma=sigma, prior=covariance)

    def _found_anew(self, unknowns: Unknowns, flat: Floats) -> Floats:
        """Prior 1 σ (P,) of parameters that have been lost, or are new."""
        turns = np.array([each.turns for each in unknowns.parameters])
        lost = np.where(turns, np.deg2rad(self.tolerances.lost_zero_deg), self.tolerances.lost_zero_mm)
        sigma = np.where(unknowns.among(frozenset({"zeros"})), lost, unknowns.sigma)
        return np.asarray(np.where(unknowns.among(PLACED), flat, sigma))

    def placed(self, rows: RowBlocks, anew: frozenset[Group] = frozenset()) -> list[RobotModel]:
        """The robot in each session; base and tool are fitted to the instrument's rows if nominal is tied by them, if
        they are in `anew`, or if they are the session's own.
        """
        groups = self.registered | anew
        models: list[RobotModel] = []
        for number, session in enumerate(self.sessions):
            begin, free = (models[0], session.own) if models else (self.model, groups)
            own = [block for block in rows.blocks if block.session == number]
            models.append(on_instrument(begin, own, free, self.taught_mm))
        return models
