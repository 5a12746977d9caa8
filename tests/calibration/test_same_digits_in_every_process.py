"""A fit gives the same digits in every process: nothing is summed in the order of a set, which differs between them."""

from __future__ import annotations

import numpy as np

from cellctl.calibration.solver.evidence import NormalEquations, System

NAMES = [f"harmonics{number}" for number in range(24)]


def test_the_evidence_has_the_same_digits_whatever_the_hashes_of_names_are():
    rng = np.random.default_rng(3)
    assert len({evidence(rng.permutation(len(NAMES))) for _ in range(20)}) == 1


def evidence(hashes):
    """Of a system with a scale of each name, where Python's hash of name number i is `hashes[i]`."""

    class Name(str):
        __slots__ = ()

        def __hash__(self):
            return int(hashes[NAMES.index(str(self))])

    rng = np.random.default_rng(8)
    factors = tuple((Name(name), 0) for name in NAMES)
    rows, one = rng.normal(size=(60, len(NAMES))), np.ones(len(NAMES))
    system = System(
        numbers={},
        fixed=(NormalEquations.of(rows[:, None, :], rng.normal(size=(60, 1))),),
        loose=factors,
        groups=np.arange(len(NAMES)),
        known=np.eye(len(NAMES)),
        change=one,
        x=0.0 * one,
        of_effects=dict.fromkeys(factors, (0.01, 10.0)),
        independent=True,
    )
    return system.evidence(dict(zip(factors, rng.normal(0.0, 4.0, len(NAMES)).tolist(), strict=True)))[0]
