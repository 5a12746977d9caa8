"""Columns of joint readings in another unit, or in another order."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from cellctl.setup_check.case import Case
from cellctl.setup_check.supposition import Change, Supposition

RADIANS_UP_TO = 2.1 * np.pi
"""No reading beyond this: they may be radians."""

DEGREES_FROM = 720.0
"""Readings beyond this are no joint's degrees, but may be degrees taken for radians."""


def other_unit(case: Case) -> Iterator[Supposition]:
    """All readings radians that were read as degrees, or the other way about."""
    largest, columns = float(np.abs(case.readings).max()), tuple(f"A{joint + 1}" for joint in range(case.n))
    if largest < RADIANS_UP_TO:
        cure = f"name the columns q1…q{case.n}, which are in radians, or write degrees"
        change = Change("joint readings are radians in columns of degrees", "data", cure, columns)
        yield Supposition((change,), case.with_readings(np.rad2deg(case.readings)))
    if largest > DEGREES_FROM:
        columns = tuple(f"q{joint + 1}" for joint in range(case.n))
        cure = f"name the columns A1…A{case.n}, which are in degrees, or write radians"
        change = Change("joint readings are degrees in columns of radians", "data", cure, columns)
        yield Supposition((change,), case.with_readings(np.deg2rad(case.readings)))


def swapped_columns(case: Case) -> Iterator[Supposition]:
    """Two joints' columns in each other's place."""
    for first, second in itertools.combinations(range(case.n), 2):
        order = np.arange(case.n)
        order[[first, second]] = second, first
        names = (f"A{first + 1}", f"A{second + 1}")
        what = f"columns {names[0]} and {names[1]} are swapped"
        change = Change(what, "data", f"exchange the names of columns {names[0]} and {names[1]}", names)
        yield Supposition((change,), case.with_readings(case.readings[:, order]), 11)
