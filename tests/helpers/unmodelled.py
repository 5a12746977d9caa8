"""Errors of joints that no model of cellctl has, by kind: those that σ was tuned on, and others that judge it.

Decision 67 has the split. `JUDGING` are the parts of `own_model.JointErrors`, and all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tests.helpers.own_model import ErrorsOfJoints, Floats, JointErrors, gravity_shares

SIZES_RAD = (1e-4, 4e-4)
HALF_SHARE = 0.3
"""Of the greatest torque: there a stiffening joint has turned by 65 % of its size."""
JOINTS = 6


@dataclass(frozen=True, eq=False)
class Coupled:
    """Products of waves of two joints: size (n, W), rad; the joints first, second (W,) and the phases (2, W)."""

    size: Floats
    first: Floats
    second: Floats
    phase: Floats

    @classmethod
    def drawn(cls, seed: int) -> Coupled:
        """Eighteen products in each joint."""
        rng, waves = np.random.default_rng([seed, 23]), 3 * JOINTS
        size = rng.normal(0.0, 1.0, (JOINTS, waves)) * rng.uniform(*SIZES_RAD, (JOINTS, 1)) * 2.0 / np.sqrt(waves)
        first, second = (rng.integers(0, JOINTS, waves) for _ in range(2))
        return cls(size, first, second, rng.uniform(0.0, 2.0 * np.pi, (2, waves)))

    def at(self, q: Floats, links: Callable[[Floats], Floats]) -> Floats:
        del links
        products = np.sin(q[:, self.first] + self.phase[0]) * np.sin(1.5 * q[:, self.second] + self.phase[1])
        return np.asarray(products @ self.size.T)


@dataclass(frozen=True, eq=False)
class Kinked:
    """Triangle waves of each joint: size (n,), period (n,), rad; phase (n,), in periods."""

    size: Floats
    period: Floats
    phase: Floats

    @classmethod
    def drawn(cls, seed: int) -> Kinked:
        """Periods that are no whole part of a turn."""
        rng = np.random.default_rng([seed, 24])
        return cls(rng.uniform(*SIZES_RAD, JOINTS), rng.uniform(0.8, 2.5, JOINTS), rng.uniform(0.0, 1.0, JOINTS))

    def at(self, q: Floats, links: Callable[[Floats], Floats]) -> Floats:
        del links
        return np.asarray(self.size * (4.0 * np.abs((q / self.period + self.phase) % 1.0 - 0.5) - 1.0))


@dataclass(frozen=True, eq=False)
class Polynomial:
    """Chebyshev polynomials of degrees 2 … 5 of each joint over ±2 rad: size (4, n), rad."""

    size: Floats

    @classmethod
    def drawn(cls, seed: int) -> Polynomial:
        """Sizes of a normal distribution."""
        rng = np.random.default_rng([seed, 25])
        return cls(rng.normal(0.0, 1.0, (4, JOINTS)) * rng.uniform(0.5e-4, 2e-4, JOINTS))

    def at(self, q: Floats, links: Callable[[Floats], Floats]) -> Floats:
        del links
        angle = np.arccos(np.clip(q / 2.0, -1.0, 1.0))
        return np.asarray(sum(size * np.cos(degree * angle) for degree, size in enumerate(self.size, 2)))


@dataclass(frozen=True, eq=False)
class Together:
    """The sum of several kinds."""

    parts: tuple[ErrorsOfJoints, ...]

    def at(self, q: Floats, links: Callable[[Floats], Floats]) -> Floats:
        return np.asarray(sum(part.at(q, links) for part in self.parts))


def _tuning(seed: int) -> ErrorsOfJoints:
    return Together((Coupled.drawn(seed), Kinked.drawn(seed), Polynomial.drawn(seed)))


def _sag(seed: int) -> ErrorsOfJoints:
    drawn = JointErrors.drawn(seed)
    return replace(drawn, encoder=0.0 * drawn.encoder, smooth=0.0 * drawn.smooth)


def _encoder(seed: int) -> ErrorsOfJoints:
    drawn = JointErrors.drawn(seed)
    return replace(drawn, yielding=0.0 * drawn.yielding, smooth=0.0 * drawn.smooth)


def _smooth(seed: int) -> ErrorsOfJoints:
    drawn = JointErrors.drawn(seed)
    return replace(drawn, yielding=0.0 * drawn.yielding, encoder=0.0 * drawn.encoder)


TUNING: Mapping[str, Callable[[int], ErrorsOfJoints]] = {
    "products of two joints": Coupled.drawn,
    "triangle waves": Kinked.drawn,
    "polynomials": Polynomial.drawn,
    "these three": _tuning,
}
JUDGING: Mapping[str, Callable[[int], ErrorsOfJoints]] = {
    "sag": _sag,
    "encoders": _encoder,
    "smooth": _smooth,
    "all three": JointErrors.drawn,
}


@dataclass(frozen=True, eq=False)
class Stiffening:
    """Joints that carry weight turn under it, less and less the greater it is: size (n,), rad, under the greatest."""

    size: Floats

    @classmethod
    def drawn(cls, seed: int) -> Stiffening:
        """About as much as the compliant joints of the simulated world."""
        return cls(np.random.default_rng([seed, 26]).uniform(*SIZES_RAD, JOINTS))

    def at(self, q: Floats, links: Callable[[Floats], Floats]) -> Floats:
        share = gravity_shares(links(q))
        return np.asarray(self.size * (1.0 + HALF_SHARE) * share / (HALF_SHARE + np.abs(share)))


@dataclass(frozen=True, eq=False)
class LoadedPlay:
    """Play of joints that carry weight: the link rests on the side to which its weight pulls it. half (n,), rad."""

    half: Floats

    @classmethod
    def drawn(cls, seed: int) -> LoadedPlay:
        """A whole play of 0.005 to 0.015°."""
        return cls(np.radians(np.random.default_rng([seed, 27]).uniform(0.0025, 0.0075, JOINTS)))

    def at(self, q: Floats, links: Callable[[Floats], Floats]) -> Floats:
        return np.asarray(self.half * np.tanh(gravity_shares(links(q)) / 0.05))


def _soft(seed: int) -> ErrorsOfJoints:
    return Together((Stiffening.drawn(seed), LoadedPlay.drawn(seed)))


def _gears(seed: int) -> ErrorsOfJoints:
    drawn = Kinked.drawn(seed)
    return replace(drawn, size=0.5 * drawn.size)


def _soft_with_gears(seed: int) -> ErrorsOfJoints:
    return Together((_soft(seed), _gears(seed)))


FLEXIBLE: Mapping[str, Callable[[int], ErrorsOfJoints]] = {
    "stiffening": _soft,
    "gears": _gears,
    "both": _soft_with_gears,
}
"""Of robots that touch in a cell, whose model is `auto`: they tuned σ; compliance, gears and play of the flexible cell
judge it."""
