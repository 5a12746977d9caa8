"""Errors that repeat with the joint: an encoder disc off its centre, an oval gear, the ripple of gears and encoders."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.model.effect import EffectInputs, OnlineTerms, OwnTurns, prismatic_field, prismatic_joints
from cellctl.calibration.model.parameter import RAD, Group, Parameter, Phrase
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.residual_model import ResidualModel
from cellctl.kinematics import Floats, SerialChain

EXPECTED_RAD = 2e-4
"""RMS of a wave of one minute of arc, which makers of strain wave and cycloidal gears state as transmission error:
prior of each band of each joint before the data scale it. Joints 1 to 3 of the UR10 in the ipa-robot-accuracy data set:
0.4e-4 … 3e-4 in each band."""

BANDS = ((1, 2), (3, 5), (6, 11), (12, 23), (24, 48))
"""Waves per turn, octave by octave: the amplitude of a band is one number, found from the data. The fastest has a
period of 7.5°; ripple of the motor's side (a gear ratio of 100: hundreds per turn) is faster than postures can sample,
and stays noise."""

SLOW = 5
"""Up to so many waves per turn a band extrapolates by some tens of degrees; faster ones cancel beyond the rows."""

Wave: TypeAlias = tuple[int, int]
"""A joint, from 1, and how many waves it makes per turn."""

_PHRASES = (
    Phrase.of("once-per-turn error", "joint"),
    Phrase.of("twice-per-turn error", "joint", 1),
    Phrase.of("ripple", "joint", 2),
)


@final
@dataclass(frozen=True)
class Harmonics(ResidualModel):
    """Each joint's error as waves of its own angle: Σ s_m sin mq + c_m (cos mq − 1).

    joints: how many. prismatic: those, from 1, that are: they have no waves. orders: waves per turn of every other
    joint. ripple: further waves as (joint from 1, waves per turn), in model files from before all orders were fitted
    together. expected: prior RMS, rad, of each band (`BANDS`) of each
    joint about 0: its amounts share the variance. `harmonic{j}_s{m}`, `…_c{m}`, rad.

    All waves of a band together are a random function of the joint's angle (a Gaussian process with a flat spectrum
    over the band). In the measured range they fit any shape. Outside it fast bands cancel, and their variance returns
    to the prior; slow bands extrapolate, within their prior. No wave has to be selected. The cosines are counted from
    the model angle 0, where all waves are 0: `theta{j}` keeps its meaning, the error at that angle (with cos mq alone
    it would become the mean over a turn).

    For the first joint with a non-vertical axis (mostly 2) the once-per-turn pair equals its own weight's,
    `compliance{j}_{j}x`, `…y`: no measurement separates them.
    """

    joints: int
    orders: tuple[int, ...] = tuple(range(1, BANDS[-1][1] + 1))
    ripple: tuple[Wave, ...] = ()
    expected: float = EXPECTED_RAD
    prismatic: frozenset[int] = prismatic_field()

    @cached_property
    def waves(self) -> tuple[Wave, ...]:
        """All waves, joint by joint, then the ripple; each once."""
        turning = (j for j in range(1, self.joints + 1) if j not in self.prismatic)
        regular = tuple((j, m) for j in turning for m in self.orders)
        return tuple(dict.fromkeys(regular + self.ripple))

    group: ClassVar[Group] = "harmonics"
    title: ClassVar[str] = "Harmonics"

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self:
        """Of every revolute joint."""
        return cls(setup.chain.n, prismatic=prismatic_joints(setup.chain))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sine and cosine of each wave, rad."""
        return tuple(
            Parameter(
                f"harmonic{j}_{part}{m}",
                RAD,
                self.group,
                f"A{j} {function} {m}q",
                _PHRASES[min(m, 3) - 1],
                str(j),
                j,
                band=band,
            )
            for (j, m), band in zip(self.waves, self.bands[::2], strict=True)
            for part, function in (("s", "sin"), ("c", "cos"))
        )

    @cached_property
    def bands(self) -> tuple[str, ...]:
        """The band (K,) of each amount: those of one band share its amplitude from the data."""
        named = {m: f"{low}–{high}" for low, high in BANDS for m in range(low, high + 1)}
        return tuple(f"harmonics of joint {j}, {named.get(m, m)} per turn" for j, m in self.waves for _ in "sc")

    @cached_property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, rad.

        A band of W waves has 2W amounts of variance v = expected²/W. Σ s sin mq + c cos mq has the variance W v =
        expected² at each q, so that is its RMS over a turn. With cos mq − 1 it is the RMS about the mean of the turn;
        about 0 the variance v (sin² + (cos − 1)²) = v (2 − 2 cos mq) of a wave is 2 v on average: √2 times as much.
        """
        counts = {band: self.bands.count(band) for band in dict.fromkeys(self.bands)}
        return np.array([self.expected * np.sqrt(2.0 / counts[band]) for band in self.bands])

    def reduced(self, bands: Collection[str]) -> Self:
        """The waves of these bands alone."""
        pairs = zip(self.waves, self.bands[::2], strict=True)
        waves = dict.fromkeys(wave for wave, band in pairs if band in bands)
        return replace(self, orders=(), ripple=tuple(waves))

    def fewer_bands(self) -> Sequence[frozenset[str]]:
        """The slow bands of a joint, which extrapolate; all bands of a joint; the slow bands of all joints."""
        waves = list(zip(self.waves, self.bands[::2], strict=True))
        joints = dict.fromkeys(joint for (joint, _), _ in waves)
        slow = {(joint, band) for (joint, order), band in waves if order <= SLOW}
        of_slow = [frozenset(band for own, band in slow if own == joint) for joint in joints]
        of_all = [frozenset(band for (own, _), band in waves if own == joint) for joint in joints]
        return (*of_slow, *of_all, frozenset(band for _, band in slow))

    def turns(self, nominal: SerialChain, at: Postures) -> OwnTurns:
        """Each wave turns its own joint."""
        joints, orders = np.array(self.waves, int).reshape(-1, 2).T
        phase = at.q[:, joints - 1] * orders
        values = np.stack([np.sin(phase), np.cos(phase) - 1.0], axis=-1).reshape(len(at), 2 * len(joints))
        return OwnTurns(np.repeat(joints - 1, 2), values)

    def add_online(self, amounts: Floats, terms: OnlineTerms) -> None:
        """Its waves."""
        for (joint, order), (sine, cosine) in zip(self.waves, amounts.reshape(-1, 2).tolist(), strict=True):
            terms.waves.append((joint - 1, order, sine, cosine))
