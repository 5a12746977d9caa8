"""Joint flexibility: by motor current from what a geometric model leaves, and by the network of the ANN paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.effects.motor_torsion import EXPECTED_RAD_PER_A
from cellctl.error_maps import ErrorMap
from cellctl.error_maps.perceptron import tuned_perceptron
from cellctl.error_maps.samples import Method, UnusableSamples, checked
from cellctl.kinematics import Floats, SerialChain


@final
@dataclass(frozen=True, eq=False)
class MotorFlexibility:
    """F of each joint: the joint lags behind its motor by F times the motor's current.

    chain: the identified robot without flexibility. amounts (n,): rad/A, positive for a spring where the current counts
    in the direction of the joint (the model's). covariance (n, n), (rad/A)².

    Source: ANN-based precision compensation via optimization of point selection, section 2.2: Δθ = F·I and
    ΔP = J_θ·diag(I)·f (eq. 18 to 22). Here with the sign of a spring: Δθ = −F·I.
    """

    chain: SerialChain
    amounts: Floats
    covariance: Floats

    @classmethod
    def identified(
        cls,
        chain: SerialChain,
        q: ArrayLike,
        currents: ArrayLike,
        left: ArrayLike,
        *,
        sigma_mm: float,
        expected: float = EXPECTED_RAD_PER_A,
    ) -> Self:
        """F from what a geometric model leaves, with the prior N(0, `expected`²) of each joint, rad/A.

        q (N, n): model angles, rad. currents (N, n): A, in the model's direction. left (N, 3): measured minus predicted
        position, mm, in the frame of `chain`; sigma_mm: its 1 σ on one axis. Raises UnusableSamples.
        """
        angles, amperes = _checked(q, currents)
        _, errors = checked(angles, left)
        lines = (-_arms(chain, angles) * amperes[:, None]).reshape(-1, chain.n) / sigma_mm
        precision = lines.T @ lines + np.eye(chain.n) / expected**2
        amounts = np.linalg.solve(precision, lines.T @ errors.reshape(-1) / sigma_mm)
        return cls(chain, np.asarray(amounts), np.asarray(np.linalg.inv(precision)))

    @property
    def sigma(self) -> Floats:
        """1 σ of each amount (n,), rad/A."""
        return np.sqrt(np.diag(self.covariance))

    def turns(self, currents: ArrayLike) -> Floats:
        """Joint-angle errors (N, n), rad, at currents (N, n), A."""
        return np.asarray(-self.amounts * np.asarray(currents, float))

    def errors(self, q: ArrayLike, currents: ArrayLike) -> Floats:
        """Position errors (N, 3), mm, at joints (N, n), rad, with the currents (N, n), A, that were measured there.

        Raises UnusableSamples for rows without currents.
        """
        angles, amperes = _checked(q, currents)
        return tcp_errors(self.chain, angles, self.turns(amperes))


def tcp_errors(chain: SerialChain, q: ArrayLike, turns: ArrayLike) -> Floats:
    """Position errors (N, 3), mm, of joints (N, n) that are off by `turns` (N, n), both rad: J_θ Δθ."""
    angles = np.asarray(q, float)
    return np.asarray(np.einsum("nij,nj->ni", _arms(chain, angles), np.asarray(turns, float)))


def _arms(chain: SerialChain, q: Floats) -> Floats:
    return np.asarray(chain.tool_jacobian(q)[:, :3])


def _checked(q: ArrayLike, currents: ArrayLike) -> tuple[Floats, Floats]:
    angles, amperes = np.asarray(q, float), np.asarray(currents, float)
    if angles.shape != amperes.shape:
        raise UnusableSamples(
            f"joints {angles.shape} and currents {amperes.shape}: one current for each joint is needed"
        )
    without = np.flatnonzero(~np.isfinite(amperes).all(axis=1))
    if without.size:
        rows = ", ".join(str(row + 1) for row in without[:5]) + (" …" if without.size > 5 else "")
        raise UnusableSamples(f"no motor currents in rows {rows}: measure them, or leave these rows out")
    return angles, amperes


HIDDEN = (20,)
ALPHAS = (1e-2, 1e-1, 1.0, 10.0, 100.0)
"""Candidates of the penalty. The labels contain the friction in the currents, which is no function of the joints; with
a small penalty the network learns it as if it were.
"""


@final
@dataclass(frozen=True, eq=False)
class FlexibilityNetwork:
    """A network that predicts Δθ of every joint from the encoder angles alone; no current is needed.

    chain: the identified robot without flexibility. map: joints (N, n), rad → Δθ (N, n), rad.

    Source: ANN-based precision compensation via optimization of point selection, section 3.4: one hidden layer,
    back-propagation. The labels are Δθ by the measured currents at the training points, which are near the task path
    (`cellctl.planning` draws them). Hidden units, training method and stopping are not published: ours are 20 units,
    `Perceptron`, and a penalty by cross-validation of the labels.
    """

    chain: SerialChain
    map: ErrorMap

    @classmethod
    def trained(
        cls,
        flexibility: MotorFlexibility,
        q: ArrayLike,
        currents: ArrayLike,
        *,
        seed: int = 0,
        method: Method | None = None,
    ) -> Self:
        """Trained on rows near the task path: joints (N, n), rad, and currents (N, n), A, measured there.

        seed: of the initial weights and the folds. method: None is a perceptron with `HIDDEN` units and one of
        `ALPHAS`. Raises UnusableSamples, LibraryMissing.
        """
        labels = flexibility.turns(currents)
        chosen = method or tuned_perceptron(hidden=HIDDEN, alphas=ALPHAS, seed=seed)
        return cls(flexibility.chain, chosen.fit(q, labels))

    def turns(self, q: ArrayLike) -> Floats:
        """Joint-angle errors (N, n), rad, at encoder angles (N, n), rad."""
        return self.map.errors(np.asarray(q, float))

    def errors(self, q: ArrayLike) -> Floats:
        """Position errors (N, 3), mm, at encoder angles (N, n), rad."""
        angles = np.asarray(q, float)
        return tcp_errors(self.chain, angles, self.turns(angles))
