"""Columns of joint readings in another unit, or in another order."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from cellctl.setup_check.hypothesis import Change, Hypothesis
from cellctl.setup_check.setup import Setup

RADIANS_UP_TO = 2.1 * np.pi
"""No reading beyond this: they may be radians."""

DEGREES_FROM = 720.0
"""Readings beyond this are no joint's degrees, but may be degrees taken for radians."""


def other_unit(setup: Setup) -> Iterator[Hypothesis]:
    """All readings radians that were read as degrees, or the other way about."""
    largest, columns = float(np.abs(setup.readings).max()), tuple(f"A{joint + 1}" for joint in range(setup.n))
    if largest < RADIANS_UP_TO:
        cure = f"name the columns q1…q{setup.n}, which are in radians, or write degrees"
        change = Change("joint readings are radians in columns of degrees", "data", cure, columns)
        yield Hypothesis((change,), setup.with_readings(np.rad2deg(setup.readings)))
    if largest > DEGREES_FROM:
        columns = tuple(f"q{joint + 1}" for joint in range(setup.n))
        cure = f"name the columns A1…A{setup.n}, which are in degrees, or write radians"
        change = Change("joint readings are degrees in columns of radians", "data", cure, columns)
        yield Hypothesis((change,), setup.with_readings(np.deg2rad(setup.readings)))


def swapped_columns(setup: Setup) -> Iterator[Hypothesis]:
    """Two joints' columns in each other's place."""
    for first, second in itertools.combinations(range(setup.n), 2):
        order = np.arange(setup.n)
        order[[first, second]] = second, first
        names = (f"A{first + 1}", f"A{second + 1}")
        what = f"columns {names[0]} and {names[1]} are swapped"
        change = Change(what, "data", f"exchange the names of columns {names[0]} and {names[1]}", names)
        yield Hypothesis((change,), setup.with_readings(setup.readings[:, order]), 11)
