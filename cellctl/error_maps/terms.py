"""Error maps as terms of a model: `--model geometry+kriging`, `--model poe+motor+network`.

Each is learnt from what the geometry and the effects leave (`LearntMap`). It is stored as arrays, with the settings as
they were given. What a setting leaves to the rows is chosen by cross-validation among the rows of the fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.learnt_map import LearntMap, Residuals
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.postures import Postures
from cellctl.error_maps import _settings
from cellctl.error_maps._settings import SPACES, Settings, by_rows, inputs, layers, number, one_of, whole
from cellctl.error_maps.inverse_distance import GridInverseDistance, GridMap, tuned_grid
from cellctl.error_maps.kriging import (
    EXPONENTIAL,
    GAUSSIAN,
    INITIAL_WEIGHTS,
    AxisMap,
    Kriging,
    KrigingMap,
    ParticleFilter,
)
from cellctl.error_maps.motor_flexibility import ALPHAS as NETWORK_ALPHAS
from cellctl.error_maps.motor_flexibility import HIDDEN as NETWORK_HIDDEN
from cellctl.error_maps.perceptron import ALPHAS, HIDDEN, Perceptron, PerceptronMap, require_library, tuned_perceptron
from cellctl.error_maps.samples import FOLDS, LEAST, Scale, Tuned, TunedMap, checked, grouped_folds
from cellctl.kinematics import Floats, SerialChain

Numbers = tuple[float, ...]


def _empty() -> Floats:
    return np.zeros((0, 0))


class _MapTerm(LearntMap):
    """A map with settings. SETTINGS: what they may be; options: as they were given; joints: of the robot."""

    __slots__ = ()

    SETTINGS: ClassVar[Settings]
    options: str
    joints: int

    @classmethod
    def of_options(cls, options: str, joints: int) -> Self:
        """To be learnt, with these settings. Raises ValueError with the cure."""
        _settings.values_of(cls.SETTINGS, options)
        made: Any = cls
        return made(joints, options)  # type: ignore[no-any-return]  # each derived class is a dataclass

    @cached_property
    def settings(self) -> dict[str, Any]:
        """What the settings mean."""
        return _settings.values_of(self.SETTINGS, self.options)


LAMBDAS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""λ that are tried, shares of the variance of the errors: noise of 0.1 % … 30 % of their scatter."""

SEARCHED = 200
"""The search for joint weights uses so many rows at most: each of some thousand particles takes their number cubed."""

TESTED = 5
"""One in so many of them is the test set of that search; fewer rows than make a test set are not searched."""

FOLD_PARTICLES, FOLD_ROUNDS = 20, 6
"""Of the shorter searches that σ takes, one in each fold."""

_POWERS = {"gaussian": GAUSSIAN, "exponential": EXPONENTIAL}


@final
@dataclass(frozen=True, eq=False)
class KrigingTerm(_MapTerm):
    """Kriging of the paper on configuration space (`kriging.Kriging`), with σ.

    points (N, k): inputs of the rows. weights (3, k), ranges (3,), regularisation λ: of the map; pulls (3, N):
    (C + λI)⁻¹ e of each axis. of_points, of_errors: means, then standard deviations, that standardise inputs (2, k) and
    errors (2, 3), mm. inflation (3,), constant (3,), mm: see `_sigma_by_folds`; empty: no σ is stated.
    """

    joints: int
    options: str = ""
    points: Floats = field(default_factory=_empty)
    weights: Floats = field(default_factory=_empty)
    ranges: Numbers = ()
    regularisation: float = 0.0
    pulls: Floats = field(default_factory=_empty)
    of_points: Floats = field(default_factory=_empty)
    of_errors: Floats = field(default_factory=_empty)
    inflation: Numbers = ()
    constant: Numbers = ()

    group: ClassVar[Group] = "kriging"
    title: ClassVar[str] = "Kriging"
    SETTINGS: ClassVar[Settings] = {
        "space": ("joints", one_of(*SPACES)),
        "semivariogram": ("gaussian", one_of(*_POWERS)),
        "lambda": ("rows", by_rows(number(1e-9, 1.0))),
        "weights": ("searched", one_of("equal", "initial", "searched")),
        "particles": ("60", whole(2, 10000)),
        "rounds": ("15", whole(1, 1000)),
        "seed": ("0", whole(0, 2**32 - 1)),
    }

    @classmethod
    def of_options(cls, options: str, joints: int) -> Self:
        """To be learnt, with these settings. Raises ValueError with the cure."""
        made = super().of_options(options, joints)
        if made.settings["weights"] == "initial" and (joints != 6 or made.settings["space"] != "joints"):
            raise ValueError("weights=initial: the paper has them for six joints; give equal or searched")
        return made

    def learnt(self, residuals: Residuals) -> Self:
        """λ by cross-validation, weights by a test set within the rows, then λ again with these weights."""
        at, errors = checked(inputs(self.settings["space"], residuals.model.nominal, residuals.at.q), residuals.errors)
        method = self._tuned(Kriging(self._initial(at), power=_POWERS[self.settings["semivariogram"]]), at, errors)
        if self._is_searched(at):
            method = self._tuned(replace(method, joint_weights=self._searched(method, at, errors)), at, errors)
        found = method.fit(at, errors)
        inflation, constant = _sigma_by_folds(self._method_of_fold(method), at, errors, residuals.stated)
        return replace(
            self,
            points=at,
            weights=found.joint_weights,
            ranges=tuple(axis.range for axis in found.axes),
            regularisation=method.regularisation,
            pulls=np.stack([axis.pull for axis in found.axes]),
            of_points=np.stack([found.joints.mean, found.joints.deviation]),
            of_errors=np.stack([found.scale.mean, found.scale.deviation]),
            inflation=inflation,
            constant=constant,
        )

    def _initial(self, at: Floats) -> Floats:
        """Weights (3, k) before any search: the paper's for six joints, equal ones for other inputs."""
        published = self.settings["space"] == "joints" and at.shape[1] == INITIAL_WEIGHTS.shape[1]
        return INITIAL_WEIGHTS if published and self.settings["weights"] != "equal" else np.ones((3, at.shape[1]))

    def _is_searched(self, at: Floats) -> bool:
        return self.settings["weights"] == "searched" and len(at) >= TESTED * LEAST

    def _tuned(self, method: Kriging, at: Floats, errors: Floats) -> Kriging:
        """`method` with λ as given, or as predicts held-out rows best."""
        given = self.settings["lambda"]
        if given is not None:
            return replace(method, regularisation=given)
        folds = grouped_folds(at, FOLDS, self.settings["seed"])
        tried = [replace(method, regularisation=each) for each in LAMBDAS]
        return min(tried, key=lambda each: float(np.sum(_held_out(lambda *_: each, at, errors, folds)[0] ** 2)))

    def _method_of_fold(self, method: Kriging) -> _MethodOf:
        """`method` as a fold finds it: weights that were searched in all rows would know those that are held out."""

        def of(at: Floats, errors: Floats) -> Kriging:
            if not self._is_searched(at):
                return method
            return replace(method, joint_weights=self._searched(method, at, errors, FOLD_PARTICLES, FOLD_ROUNDS))

        return of

    def _searched(
        self, method: Kriging, at: Floats, errors: Floats, particles: int | None = None, rounds: int | None = None
    ) -> Floats:
        settings = self.settings
        some = np.random.default_rng(settings["seed"]).permutation(len(at))[:SEARCHED]
        test = grouped_folds(at[some], TESTED, settings["seed"])[0]
        own, other = some[~test], some[test]
        search = ParticleFilter(
            self._initial(at),
            particles=particles or settings["particles"],
            rounds=rounds or settings["rounds"],
            seed=settings["seed"],
        )
        return search.weights(at[own], errors[own], at[other], errors[other], method.regularisation, method.power)

    @cached_property
    def _map(self) -> KrigingMap:
        of_points, of_errors = Scale(*self.of_points), Scale(*self.of_errors)
        standard, power = of_points.standardised(self.points), _POWERS[self.settings["semivariogram"]]
        x, y, z = (
            AxisMap(standard * own, None, reach, self.regularisation, power, pull)
            for own, reach, pull in zip(self.weights, self.ranges, self.pulls, strict=True)
        )
        return KrigingMap(of_points, of_errors, self.weights, (x, y, z))

    def fixed_shift(self, nominal: SerialChain, at: Postures) -> Floats | None:
        """The map's errors (N, 3), mm."""
        return self._map.errors(inputs(self.settings["space"], nominal, at.q)) if self.points.size else None

    def variance(self, nominal: SerialChain, at: Postures) -> Floats:
        """Kriging variance (N,), mm², scaled to the errors of held-out rows; NaN where these were too few."""
        if not self.points.size:
            return np.zeros(len(at))
        if not self.inflation:
            return np.full(len(at), np.nan)
        of_axes = self._map.variance(inputs(self.settings["space"], nominal, at.q))
        return np.asarray((of_axes * np.array(self.inflation) ** 2 + np.array(self.constant) ** 2).mean(axis=1))


_MethodOf = Callable[[Floats, Floats], Kriging]
"""The method for inputs (N, k) and errors (N, 3)."""


def _held_out(method: _MethodOf, at: Floats, errors: Floats, folds: list[Any]) -> tuple[Floats, Floats]:
    """Errors (N, 3), mm, that maps of the other folds leave at each row, and their kriging variances (N, 3), mm²."""
    away, variances = np.empty(errors.shape), np.empty(errors.shape)
    for test in folds:
        made = method(at[~test], errors[~test]).fit(at[~test], errors[~test])
        away[test], variances[test] = made.errors(at[test]) - errors[test], made.variance(at[test])
    return away, variances


LEAST_SHOWN = 20
"""Fewer rows do not show how far held-out ones are from the map."""

_FACTORS = np.concatenate([[0.0], np.geomspace(0.03, 30.0, 61)])
_SHARES = np.geomspace(0.01, 1.5, 41)
"""Factors on the standard deviation of kriging that are tried, and constant parts, in RMS of the held-out errors."""


def _sigma_by_folds(method: _MethodOf, at: Floats, errors: Floats, stated: Floats) -> tuple[Numbers, Numbers]:
    """Factors s (3,) on the standard deviation √v of kriging, and constant parts c (3,), mm, along each axis.

    The most probable ones for errors e of held-out rows, e ~ N(0, s² v + c² + u), u what is stated besides. Kriging
    takes its range and sill as known, and all pairs as independent: by itself v is some times too small or too large.
    c is what varies faster than the distance of the rows; without it σ is far too small where rows are dense. Both are
    empty where fewer than `LEAST_SHOWN` rows were measured.
    """
    if len(at) < LEAST_SHOWN:
        return (), ()
    away, variances = _held_out(method, at, errors, grouped_folds(at, FOLDS, 1))
    factors, constants = [], []
    for e, v, u in zip(away.T, variances.T, stated.T, strict=True):
        rms = max(float(np.sqrt(np.mean(e**2))), 1e-9)
        grid = [(s, c * rms) for s in _FACTORS for c in _SHARES]
        total = np.array([s**2 * v + c**2 + u for s, c in grid])
        s, c = grid[int(np.argmin(np.sum(np.log(total) + e**2 / total, axis=1)))]
        factors.append(float(s))
        constants.append(float(c))
    return tuple(factors), tuple(constants)


class _WithoutSigma(_MapTerm):
    """A map that has no σ of its own."""

    __slots__ = ()

    def variance(self, nominal: SerialChain, at: Postures) -> Floats:
        """NaN (N,): not known; 0 before it is learnt."""
        return np.full(len(at), np.nan if self._is_learnt else 0.0)

    @property
    def _is_learnt(self) -> bool:
        raise NotImplementedError


@final
@dataclass(frozen=True, eq=False)
class InverseDistanceTerm(_WithoutSigma):
    """Inverse-distance weighting on a grid (`inverse_distance`), over places unless told otherwise.

    points (N, k), errors (N, 3), mm: of the rows. pitch, power: of the grid. unit (k,): divides the inputs; 1 for
    places, and the standard deviations of inputs in different units.
    """

    joints: int
    options: str = ""
    points: Floats = field(default_factory=_empty)
    errors: Floats = field(default_factory=_empty)
    pitch: float = 0.0
    power: float = 0.0
    unit: Numbers = ()

    group: ClassVar[Group] = "idw"
    title: ClassVar[str] = "Inverse distance"
    SETTINGS: ClassVar[Settings] = {
        "space": ("position", one_of(*SPACES)),
        "pitch": ("rows", by_rows(number(1e-6, 1e6))),
        "power": ("rows", by_rows(number(0.1, 20.0))),
        "seed": ("0", whole(0, 2**32 - 1)),
    }

    @property
    def _is_learnt(self) -> bool:
        return bool(self.points.size)

    def learnt(self, residuals: Residuals) -> Self:
        """Pitch and power by cross-validation, where they are not given."""
        space, pitch, power, seed = (self.settings[key] for key in ("space", "pitch", "power", "seed"))
        at, errors = checked(inputs(space, residuals.model.nominal, residuals.at.q), residuals.errors)
        spread = at.std(axis=0)
        unit = np.ones(at.shape[1]) if space == "position" else np.where(spread > 0.0, spread, 1.0)
        candidates = tuned_grid(at / unit).candidates
        tried = dict.fromkeys(GridInverseDistance(pitch or each.pitch, power or each.power) for each in candidates)
        found = Tuned(list(tried), seed=seed).fit_checked(at / unit, errors).method
        return replace(self, points=at, errors=errors, pitch=found.pitch, power=found.power, unit=tuple(unit.tolist()))

    def fixed_shift(self, nominal: SerialChain, at: Postures) -> Floats | None:
        """The map's errors (N, 3), mm."""
        if not self._is_learnt:
            return None
        unit = np.array(self.unit)
        made = GridMap(self.points / unit, self.errors, self.pitch, self.power)
        return made.errors(inputs(self.settings["space"], nominal, at.q) / unit)


_TRAINED: Settings = {
    "layers": ("rows", by_rows(layers)),
    "alpha": ("rows", by_rows(number(1e-9, 1e6))),
    "seed": ("0", whole(0, 2**32 - 1)),
}


class _Trained(_WithoutSigma):
    """A perceptron: weights and offsets (1, h) from layer to layer; of_points (2, k), of_outputs (2, m): means, then
    standard deviations, that standardise inputs and outputs.
    """

    __slots__ = ()

    weights: tuple[Floats, ...]
    offsets: tuple[Floats, ...]
    of_points: Floats
    of_outputs: Floats

    @classmethod
    def of_options(cls, options: str, joints: int) -> Self:
        """To be learnt, with these settings. Raises ValueError with the cure, LibraryMissing."""
        require_library()
        return super().of_options(options, joints)

    @property
    def _is_learnt(self) -> bool:
        return bool(self.weights)

    def _trained(self, at: Floats, outputs: Floats, hidden: Any, alphas: Numbers) -> dict[str, Any]:
        """The fields of a perceptron trained on these samples; hidden, alphas: candidates where the rows choose."""
        layers, alpha, seed = (self.settings[key] for key in ("layers", "alpha", "seed"))
        units, penalties = hidden if layers is None else (layers,), alphas if alpha is None else (alpha,)
        if len(units) * len(penalties) == 1:
            made = Perceptron(units[0], penalties[0], seed).fit_checked(at, outputs)
        else:
            tuned: TunedMap[Perceptron] = tuned_perceptron(hidden=units, alphas=penalties, seed=seed).fit_checked(
                at, outputs
            )
            assert isinstance(tuned.map, PerceptronMap)
            made = tuned.map
        return {
            "weights": made.weights,
            "offsets": tuple(each[None] for each in made.offsets),
            "of_points": np.stack([made.inputs.mean, made.inputs.deviation]),
            "of_outputs": np.stack([made.outputs.mean, made.outputs.deviation]),
        }

    def _outputs(self, at: Floats) -> Floats:
        offsets = tuple(each[0] for each in self.offsets)
        return PerceptronMap(Scale(*self.of_points), Scale(*self.of_outputs), self.weights, offsets).errors(at)


@final
@dataclass(frozen=True, eq=False)
class PerceptronTerm(_Trained):
    """A perceptron of position errors, over places unless told otherwise: the kriging paper's reference 14."""

    joints: int
    options: str = ""
    weights: tuple[Floats, ...] = ()
    offsets: tuple[Floats, ...] = ()
    of_points: Floats = field(default_factory=_empty)
    of_outputs: Floats = field(default_factory=_empty)

    group: ClassVar[Group] = "perceptron"
    title: ClassVar[str] = "Perceptron"
    SETTINGS: ClassVar[Settings] = {"space": ("position", one_of(*SPACES)), **_TRAINED}

    def learnt(self, residuals: Residuals) -> Self:
        """Trained on the errors of the TCP."""
        at, errors = checked(inputs(self.settings["space"], residuals.model.nominal, residuals.at.q), residuals.errors)
        return replace(self, **self._trained(at, errors, HIDDEN, ALPHAS))

    def fixed_shift(self, nominal: SerialChain, at: Postures) -> Floats | None:
        """The map's errors (N, 3), mm."""
        return self._outputs(inputs(self.settings["space"], nominal, at.q)) if self._is_learnt else None


DAMPING = 1e-2
"""Of the least turns of the joints that explain an error, in shares of the reach: near a singularity they would be
large."""


@final
@dataclass(frozen=True, eq=False)
class NetworkTerm(_Trained):
    """A network of joint errors Δθ over the encoder angles: ANN-based precision compensation via optimization of point
    selection, section 3.4.

    With flexibility by motor current (`motor`) its labels are Δθ = −F·I at the measured currents, and it takes the
    place of the currents in every prediction. Without, they are the least turns that explain what the geometry leaves.
    flexibility (n,): F, rad/A; empty without `motor`.
    """

    joints: int
    options: str = ""
    weights: tuple[Floats, ...] = ()
    offsets: tuple[Floats, ...] = ()
    of_points: Floats = field(default_factory=_empty)
    of_outputs: Floats = field(default_factory=_empty)
    flexibility: Numbers = ()

    group: ClassVar[Group] = "network"
    title: ClassVar[str] = "Network"
    SETTINGS: ClassVar[Settings] = _TRAINED

    def learnt(self, residuals: Residuals) -> Self:
        """Trained on the turns of the joints."""
        amounts = [residuals.model.amount(f"flexibility{joint}") for joint in range(1, self.joints + 1)]
        flexibility = tuple(each for each in amounts if each is not None)
        if flexibility and residuals.at.currents is not None:
            labels = -np.array(flexibility) * residuals.at.currents
        else:
            flexibility, labels = (), _least_turns(residuals.model.chain, residuals)
        at, turns = checked(residuals.at.q, labels)
        return replace(self, flexibility=flexibility, **self._trained(at, turns, NETWORK_HIDDEN, NETWORK_ALPHAS))

    def fixed_turns(self, nominal: SerialChain, at: Postures) -> Floats | None:
        """The network's Δθ (N, n), rad, less that by the currents of `at`, which the effect `motor` adds."""
        if not self._is_learnt:
            return None
        turns = self._outputs(at.q)
        if self.flexibility and at.currents is not None:
            turns = turns + np.array(self.flexibility) * np.nan_to_num(at.currents)
        return turns


def _least_turns(chain: SerialChain, residuals: Residuals) -> Floats:
    """Δθ (N, n), rad, with the least ‖J Δθ − e‖² + (d ‖Δθ‖)²: Jᵀ (JJᵀ + d²I)⁻¹ e, d a share of the reach."""
    errors = residuals.errors @ chain.base_now[:3, :3].T
    arms = np.asarray(chain.tool_jacobian(residuals.at.q)[:, :3])
    square = arms @ np.swapaxes(arms, 1, 2) + (DAMPING * chain.reach_mm) ** 2 * np.eye(3)
    return np.asarray(np.einsum("nij,ni->nj", arms, np.linalg.solve(square, errors[..., None])[..., 0]))


TERMS: tuple[type[LearntMap], ...] = (KrigingTerm, InverseDistanceTerm, PerceptronTerm, NetworkTerm)
"""All error maps that a model may have."""
