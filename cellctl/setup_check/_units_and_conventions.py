"""Hypotheses that robot file, data set or artefact use another unit, order, convention or form of orientation."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.calibration.rows import Measured
from cellctl.kinematics import Floats, SerialChain, TableConvention, abc_from_rotation
from cellctl.kinematics.geometry import LinkTable
from cellctl.setup_check.hypothesis import Change, Hypothesis, Setup

UNITS = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4}
"""Units of length and their size, mm."""

XYZ = ("X", "Y", "Z")

RADIANS_UP_TO = 2.1 * np.pi
"""If no angle is larger, they may be radians."""

DEGREES_FROM = 720.0
"""Readings beyond this cannot be a joint's degrees, but may be degrees that were read as radians."""

CONVENTIONS: dict[TableConvention, str] = {"mdh-hayati": "standard DH", "dh-craig": "Craig's modified DH"}

SMALL_MM = 50.0
"""A robot that reaches no further was written in metres, or in inches at most ten times as long."""


def other_unit(setup: Setup) -> Iterator[Hypothesis]:
    """All readings are radians that were read as degrees, or the other way round; or a prismatic joint's are not mm."""
    yield from _other_travel_unit(setup)
    turning = setup.revolute
    if not turning.any():
        return
    largest = float(np.abs(setup.readings[:, turning]).max())
    degrees, radians = (tuple(np.array(_columns(setup, letter))[turning].tolist()) for letter in "Aq")
    if largest < RADIANS_UP_TO:
        cure = f"name the columns q1…q{setup.n}, which are in radians, or write degrees"
        change = Change("joint readings are radians in columns of degrees", "data", cure, degrees)
        readings = np.where(turning, np.rad2deg(setup.readings), setup.readings)
        yield Hypothesis((change,), setup.with_readings(readings))
        if not turning.all():
            what = "joint readings are radians and m in columns of degrees and mm"
            change = replace(change, what=what, cure=f"name the columns q1…q{setup.n}", key=_columns(setup, "A"))
            yield Hypothesis((change,), setup.with_readings(setup.joints.in_reading_units(setup.readings)))
    if largest > DEGREES_FROM:
        cure = f"name the columns A1…A{setup.n}, which are in degrees, or write radians"
        change = Change("joint readings are degrees in columns of radians", "data", cure, radians)
        readings = np.where(turning, np.deg2rad(setup.readings), setup.readings)
        yield Hypothesis((change,), setup.with_readings(readings))


def _columns(setup: Setup, letter: str) -> tuple[str, ...]:
    return tuple(f"{letter}{joint}" for joint in range(1, setup.n + 1))


def _other_travel_unit(setup: Setup) -> Iterator[Hypothesis]:
    for joint in np.flatnonzero(~setup.revolute):
        name = f"A{joint + 1}"
        for unit, factor in UNITS.items():
            change = Change(f"{name} is {unit}", "data", f"write {name}, a prismatic joint, in mm", (name,))
            readings = setup.readings.copy()
            readings[:, joint] *= factor
            yield Hypothesis((change,), setup.with_readings(readings))


def swapped_columns(setup: Setup) -> Iterator[Hypothesis]:
    """The columns of two joints are swapped."""
    for first, second in itertools.combinations(range(setup.n), 2):
        change = _swapped((f"A{first + 1}", f"A{second + 1}"), "columns {} and {} are swapped")
        readings = setup.readings.copy()
        readings[:, [first, second]] = readings[:, [second, first]]
        yield Hypothesis((change,), setup.with_readings(readings), 11)


def _swapped(names: tuple[str, str], what: str) -> Change:
    cure = f"exchange the names of columns {names[0]} and {names[1]}"
    return Change(what.format(*names), "data", cure, names)


def other_convention(setup: Setup) -> Iterator[Hypothesis]:
    """The link table is in the other DH convention."""
    table = setup.task.model.chain.table
    if not isinstance(table, LinkTable):
        return
    other: TableConvention = "dh-craig" if table.convention == "mdh-hayati" else "mdh-hayati"
    what = f"the link table is in {CONVENTIONS[other]} and read as {CONVENTIONS[table.convention]}"
    change = Change(what, "robot", f"convention: {other}", ("convention",))
    yield Hypothesis((change,), _with_table(setup, LinkTable(other, table.links)))


def metres(setup: Setup) -> Iterator[Hypothesis]:
    """The link lengths are metres; the tool is registered or known."""
    table = setup.task.model.chain.table
    if isinstance(table, LinkTable) and sum(abs(link.d) + abs(link.a) for link in table.links) < SMALL_MM:
        change = Change("link lengths are metres", "robot", "write d and a in mm", ("links",))
        links = tuple(replace(link, d=1000.0 * link.d, a=1000.0 * link.a) for link in table.links)
        yield Hypothesis((change,), _with_table(setup, LinkTable(table.convention, links)))


def _with_table(setup: Setup, table: LinkTable) -> Setup:
    chain = setup.task.model.chain
    return setup.with_chain(SerialChain.from_links(table.convention, table.links, chain.base_now, chain.tool_now))


def other_length(setup: Setup) -> Iterator[Hypothesis]:
    """X, Y, Z are in another unit."""
    if setup.task.rows.has_positions:
        for unit, factor in UNITS.items():
            change = Change(f"X, Y, Z are {unit}", "data", "write X, Y, Z in mm", XYZ)
            yield Hypothesis((change,), setup.with_positions(factor * setup.positions))


def other_spheres(setup: Setup) -> Iterator[Hypothesis]:
    """The radii of the spheres are in another unit, or are diameters, or half the radius."""
    if not setup.task.rows.has_distances:
        return
    factors = {f"radii are {unit}": factor for unit, factor in UNITS.items()}
    factors |= {"diameters are given as radii": 0.5, "radii are given as diameters": 2.0}
    for what, factor in factors.items():

        def scaled(block: Measured, factor: float = factor) -> Measured:
            return block if block.distances is None else block.with_distances(factor * block.distances)

        change = Change(f"spheres: {what}", "artefact", "write radii, or diameters, as asked, in mm", ("radius",))
        yield Hypothesis((change,), setup.with_blocks(scaled), 1)


def other_hand(setup: Setup) -> Iterator[Hypothesis]:
    """The measuring frame is left-handed. Orientations show which axis; positions fit any mirror, by the base."""
    left_handed = "the measuring frame is left-handed"
    blocks = [block for block in setup.task.rows.blocks if len(block)]
    if any(block.orientations is not None for block in blocks):
        for axis, name in enumerate(XYZ):
            mirror = np.diag([-1.0 if other == axis else 1.0 for other in range(3)])
            change = Change(f"{left_handed}: {name} is reversed", "data", f"reverse the sign of {name}", (name,))
            yield Hypothesis((change,), setup.with_positions(setup.positions @ mirror))
            change = Change(f"{left_handed}, orientations too", "data", "export a right-handed frame")
            yield Hypothesis((change,), _mirrored_poses(setup, mirror), 1 + axis)
        for first, second in itertools.combinations(range(3), 2):
            order = [second if axis == first else first if axis == second else axis for axis in range(3)]
            change = _swapped((XYZ[first], XYZ[second]), f"{left_handed}: {{}} and {{}} are swapped")
            yield Hypothesis((change,), setup.with_positions(setup.positions[:, order]))
    elif any(block.positions is not None for block in blocks):
        cure = "reverse one of X, Y, Z, or exchange two of them: the instrument's export says which"
        change = Change(left_handed, "data", cure, XYZ)
        yield Hypothesis((change,), setup.with_positions(setup.positions * [1.0, -1.0, 1.0]))


def _mirrored_poses(setup: Setup, mirror: Floats) -> Setup:
    """Positions mirrored; of poses the orientations too."""

    def mirrored(block: Measured) -> Measured:
        if block.orientations is None or block.positions is None:
            return block
        return block.with_positions(block.positions @ mirror).with_orientations(mirror @ block.orientations @ mirror)

    return setup.with_blocks(mirrored)


ABC = ("A", "B", "C")
CONVERT = "convert to Rz(A) Ry(B) Rx(C), or give QW, QX, QY, QZ"
SEQUENCES = [f"{a}{b}{c}" for a, b, c in itertools.product("XYZ", repeat=3) if a != b != c]


def other_orientations(setup: Setup) -> Iterator[Hypothesis]:
    """Other Euler angles, rotation vectors, radians; inverse rotations.

    The angles are computed from the rotations that were read, so that |B| ≤ 90°.
    """
    measured = [rotations for block in setup.task.rows.blocks if (rotations := block.orientations) is not None]
    if not measured:
        return
    yield _hypothesis(setup, "orientations are inverse: from tool to frame", "invert each", 2, Rotation.inv)
    largest = max(np.abs(abc_from_rotation(rotations)).max(initial=0.0) for rotations in measured)
    for unit, factor in (("", 1.0), (" in radians", 180.0 / np.pi))[: 1 + (largest < RADIANS_UP_TO)]:
        yield from _euler_angles(setup, unit, factor)

        def of_vector(read: Rotation, factor: float = factor) -> Rotation:
            return Rotation.from_rotvec(factor * _abc(read), degrees=True)

        yield _hypothesis(setup, f"A, B, C are a rotation vector{unit}", CONVERT, 1, of_vector)


def _euler_angles(setup: Setup, unit: str, factor: float) -> Iterator[Hypothesis]:
    for sequence in (form for letters in SEQUENCES for form in (letters, letters.lower())):

        def of_angles(read: Rotation, sequence: str = sequence) -> Rotation:
            return Rotation.from_euler(sequence, factor * _abc(read), degrees=True)

        if sequence != "ZYX":
            axes = "turned" if sequence.isupper() else "fixed"
            what = f"A, B, C are {sequence.upper()} angles{unit}, about the {axes} axes"
            complexity = 0 if sequence.upper() == "XYZ" else 1 if len(set(sequence)) == 3 else 2
            yield _hypothesis(setup, what, CONVERT, complexity, of_angles)
        elif unit:
            yield _hypothesis(setup, "A, B, C are radians", "write degrees", 0, of_angles)


def _abc(rotation: Rotation) -> Floats:
    return abc_from_rotation(rotation.as_matrix())


def _hypothesis(
    setup: Setup, what: str, cure: str, complexity: int, change: Callable[[Rotation], Rotation]
) -> Hypothesis:
    def turned(block: Measured) -> Measured:
        if block.orientations is None:
            return block
        return block.with_orientations(change(Rotation.from_matrix(block.orientations)).as_matrix())

    return Hypothesis((Change(what, "data", cure, ABC),), setup.with_blocks(turned), complexity)
