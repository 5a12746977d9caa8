"""An identified robot as arrays, for a process that corrects a controller's own motion in every cycle.

The arrays hold all parts of a model that are functions of the joints at a constant load and temperature. That process
computes δ with f*(q + δ) = f(q), f the controller's kinematics and f* the identified robot, without fitting code.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration import OnlineTerms, Postures, RobotModel
from cellctl.kinematics import Floats, JointMap, SerialChain, inverse_pose

Arrays = Mapping[str, tuple[float, ...]]
"""Arrays by name, as `CorrectionModel` of `cellctl.devices` explains them."""


@final
@dataclass(frozen=True, slots=True)
class OnlineArrays:
    """arrays: of the model. left_out: parts of the model that cannot be corrected on-line, in words."""

    arrays: Arrays
    left_out: tuple[str, ...]


def online_arrays(
    identified: RobotModel, joints: JointMap, lower: Floats, upper: Floats, fade_deg: float, at: Postures | None = None
) -> OnlineArrays:
    """The arrays of `identified`, whose base and tool count from the nominal poses of its chain.

    lower, upper (n,): measured region, controller readings, deg; fade_deg: outside it the correction fades to zero over
    this width. at: one posture with the payload and temperature difference that hold throughout; None: neither.
    Raises ValueError for an effect that cannot be computed on-line.
    """
    chain = identified.chain
    bare = chain.with_parameters({}).with_base(np.eye(4))
    conditions = Postures(np.zeros((1, chain.n))) if at is None else at
    terms = OnlineTerms(conditions, chain.n)
    start = len(chain.parameters)
    for effect in identified.effects:
        stop = start + len(effect.parameters)
        effect.add_online(identified.deviations[start:stop], terms)
        start = stop
    named = {
        "sign": joints.sign,
        "offset": np.deg2rad(joints.offset),
        "base": chain.base,
        "links": _constants(bare, flange=True),
        "tool": chain.tool,
        "identified": _constants(chain, flange=False),
        "identified_base": chain.base_now[:3, :3],
        **_arrays(terms, bare),
        "lower": lower,
        "upper": upper,
        "fade": np.array([fade_deg]),
    }
    arrays = {name: tuple(np.ravel(values).astype(float).tolist()) for name, values in named.items()}
    return OnlineArrays(arrays, tuple(terms.left_out))


def _constants(chain: SerialChain, *, flange: bool) -> Floats:
    """C0 … Cn (n + 1, 4, 4) of C0 Rz(q1) C1 … Rz(qn) Cn, up to the flange or the TCP: steps between frames at q = 0."""
    home = np.zeros(chain.n)
    frames = chain.frames(home)
    ends = [*frames[:-1], frames[-1] if flange else chain.forward(home)]
    return np.array([ends[0], *(inverse_pose(a) @ b for a, b in itertools.pairwise(ends))])


def _arrays(terms: OnlineTerms, bare: SerialChain) -> dict[str, Floats]:
    """The terms by name. bare: the nominal chain in its own base frame."""
    n, at = bare.n, terms.at
    waves = np.array(terms.waves).reshape(-1, 4).T
    places, scales, weights = ([node[part] for node in terms.nodes] for part in range(3))
    return {
        "down": np.array(terms.down),
        "weight": terms.weight,
        "load": terms.load,
        "load_place": bare.tool[:3, 3] if at.payload_at is None else at.payload_at[0],
        "bend": np.array([terms.bend]),
        "stretch": terms.stretch,
        **dict(zip(("wave_joint", "wave_order", "wave_sine", "wave_cosine"), waves, strict=True)),
        "node_place": np.concatenate([np.zeros((0, n)), *places]),
        "node_scale": np.concatenate([np.zeros((0, n)), *scales]),
        "node_weight": np.concatenate([np.zeros((0, 3)), *weights]).T,
    }
