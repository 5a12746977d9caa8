"""From robot file, data set and artefact to what the identification takes: arrays and names."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, final

from cellctl.files import InputError, Problem
from cellctl.formats.artefact import Artefact
from cellctl.formats.columns import Sieve, joint_readings
from cellctl.formats.dataset import DataSet, Rejected
from cellctl.formats.robot import RobotFile

if TYPE_CHECKING:
    from cellctl.calibration import PoseRows, PositionRows, RobotModel, SpacingRows, Task
    from cellctl.kinematics import Floats

Measure: TypeAlias = Literal["position", "pose", "sphere", "socket"]
"""What a row measures."""

ModelChoice: TypeAlias = Literal["auto", "geometry"]
"""geometry: link table and tool; auto: tool deflection too, where a touching tool has a mass."""

ROTATION_SIGMA_RAD = math.radians(0.005)
"""σ of a measured orientation where the data do not say; it grows with the residuals as all σ do."""

_ABC = ("A", "B", "C")
_QUATERNION = ("QW", "QX", "QY", "QZ")
_SIGMAS = ("sX", "sY", "sZ")


@final
@dataclass(frozen=True, eq=False)
class Measurements:
    """Usable rows, ready for the identification.

    task: model and rows. readings (N, n): controller readings, deg. lines (N,): where each row stood in the file.
    sets (N,): the `set` column, empty where there is none. measure: what the rows are. own_sigma: whether the rows say
    themselves how much they scatter, rather than the robot file.
    """

    task: Task
    readings: Floats
    lines: tuple[int, ...]
    sets: tuple[str, ...]
    measure: Measure
    rejected: tuple[Rejected, ...]
    own_sigma: bool = False


def measurements(
    robot: RobotFile,
    data: DataSet,
    *,
    measure: Measure | None = None,
    model: ModelChoice = "auto",
    artefact: Artefact | None = None,
    use_distances: bool = True,
) -> Measurements:
    """The usable rows of `data` as a task for `cellctl.calibration.fit`.

    measure: default by the columns there are (`measure_of`). artefact: for touches; its certified distances are used
    unless `use_distances` is false. Raises InputError where the columns do not allow it, or no row is left.
    """
    kind = measure or measure_of(data)
    _check_columns(data, kind, artefact)
    sieve = Sieve(data)
    readings = joint_readings(sieve, robot)
    q = robot.joint_map().model(readings)
    rows: Callable[[list[int]], dict[str, Any]]
    if kind == "sphere":
        rows = _touches(sieve, robot, artefact, q, use_distances)
    else:
        rows = _poses(sieve, robot, q) if kind == "pose" else _positions(sieve, robot, q)
    sets = _sets(sieve)
    kept = sieve.kept()
    return Measurements(
        _task(nominal_model(robot, deflection=model == "auto" and kind == "sphere"), rows(kept)),
        readings[kept],
        tuple(data.lines[row] for row in kept),
        tuple(sets[row] for row in kept),
        kind,
        tuple(sieve.rejected()),
        any(any(data.texts(name)) for name in _SIGMAS),
    )


def measure_of(data: DataSet) -> Measure:
    """What the columns say is measured: filled `sphere` or `socket`, else poses where orientation is, else points."""
    if any(data.texts("sphere")):
        return "sphere"
    if any(data.texts("socket")):
        return "socket"
    oriented = any(data.has(*names) and any(data.texts(names[0])) for names in (_ABC, _QUATERNION))
    return "pose" if oriented else "position"


def nominal_model(robot: RobotFile, *, deflection: bool) -> RobotModel:
    """The robot as its file says; with `deflection` its tool can bend, if it has a mass and stands out along z."""
    from cellctl.calibration import STANDARD_GRAVITY, RobotModel, ToolDeflection

    length_m, load_n = robot.tool.xyz[2] / 1000.0, robot.tool.mass * STANDARD_GRAVITY
    bends = deflection and length_m > 0.0 and load_n > 0.0
    return RobotModel(robot.chain(), (ToolDeflection(length_m, load_n),) if bends else ())


def _task(model: RobotModel, parts: dict[str, Any]) -> Task:
    from cellctl.calibration import Task

    return Task(model, **parts)


def _check_columns(data: DataSet, kind: Measure, artefact: Artefact | None) -> None:
    if kind == "socket":
        raise InputError(Problem(data.file, 1, 0, "sockets cannot be used yet", "measure positions, poses or spheres"))
    needed = ("sphere",) if kind == "sphere" else ("X", "Y", "Z")
    missing = [name for name in needed if not data.has(name)]
    if missing:
        what = f"has no column {', '.join(missing)}, which a {kind} needs"
        raise InputError(Problem(data.file, 1, 0, what, f"columns here: {', '.join(data.columns[:12])}"))
    if kind == "pose" and not any(data.has(*names) for names in (_ABC, _QUATERNION)):
        raise InputError(
            Problem(data.file, 1, 0, "has no orientation: A, B, C or QW, QX, QY, QZ", "--measure position")
        )
    if kind == "sphere" and artefact is None and not data.has("radius"):
        what = "has touches on spheres, but neither a column radius nor an artefact says how large these are"
        raise InputError(Problem(data.file, 1, 0, what, "give --artefact FILE (the cell file does)"))


def _sigma(sieve: Sieve, robot: RobotFile) -> Floats:
    """σ of each coordinate (N, 3), mm: sX, sY, sZ, or the robot's repeatability on one axis."""
    import numpy as np

    default = robot.repeatability / math.sqrt(3.0)
    columns = [sieve.numbers(name, missing=default) for name in _SIGMAS]
    for name, values in zip(_SIGMAS, columns, strict=True):
        for row, value in enumerate(values):
            if value <= 0.0:
                sieve.reject(row, f"{name} is {value:g}: a standard deviation is above 0")
    return np.array(columns).T


def _positions(sieve: Sieve, robot: RobotFile, q: Floats) -> Callable[[list[int]], dict[str, PositionRows]]:
    import numpy as np

    from cellctl.calibration import PositionRows

    xyz = np.array([sieve.numbers(name) for name in "XYZ"]).T
    sigma = _sigma(sieve, robot)
    return lambda kept: {"rows": PositionRows(q[kept], xyz[kept], sigma[kept])}


def _poses(sieve: Sieve, robot: RobotFile, q: Floats) -> Callable[[list[int]], dict[str, PoseRows]]:
    import numpy as np

    from cellctl.calibration import PoseRows
    from cellctl.kinematics import pose, rotation_from_abc, rotation_from_quaternion

    xyz = np.array([sieve.numbers(name) for name in "XYZ"]).T
    names = _QUATERNION if sieve.data.has(*_QUATERNION) else _ABC
    turns = np.array([sieve.numbers(name) for name in names]).T
    if names is _QUATERNION:
        for row in np.flatnonzero(np.abs(np.linalg.norm(turns, axis=1) - 1.0) > 0.01):
            sieve.reject(int(row), "QW, QX, QY, QZ is no unit quaternion")
    rotation = rotation_from_quaternion if names is _QUATERNION else rotation_from_abc
    sigma = np.hstack([_sigma(sieve, robot), np.full((len(xyz), 3), ROTATION_SIGMA_RAD)])
    return lambda kept: {"rows": PoseRows(q[kept], pose(rotation(turns[kept]), xyz[kept]), sigma[kept])}


def _touches(
    sieve: Sieve, robot: RobotFile, artefact: Artefact | None, q: Floats, use_distances: bool
) -> Callable[[list[int]], dict[str, Any]]:
    import numpy as np

    from cellctl.calibration import TouchRows

    names = sieve.data.texts("sphere")
    reach = np.array(_reaches(sieve, artefact, names))
    sigma = np.sqrt(np.mean(_sigma(sieve, robot) ** 2, axis=1, keepdims=True))

    def build(kept: list[int]) -> dict[str, Any]:
        spheres = tuple(sorted({names[row] for row in kept}))
        index = np.array([spheres.index(names[row]) for row in kept])
        return {
            "rows": TouchRows(q[kept], index, reach[kept], sigma[kept]),
            "points": spheres,
            "rough": _rough_centres(artefact, spheres),
            "spacings": _spacings(artefact, spheres) if use_distances else None,
        }

    return build


def _reaches(sieve: Sieve, artefact: Artefact | None, names: list[str]) -> list[float]:
    """Sphere radius plus tip radius plus `drift` for each row, mm. A `radius` other than the artefact's is rejected."""
    tips = _tip_radii(sieve, artefact)
    given = sieve.numbers("radius", missing=0.0)
    drift = sieve.numbers("drift", missing=0.0)
    result = []
    for row, (name, radius) in enumerate(zip(names, given, strict=True)):
        sphere = artefact.sphere(name) if artefact else None
        known = sphere.diameter / 2.0 if sphere else radius
        if not name:
            sieve.reject(row, "sphere is missing")
        elif artefact and sphere is None:
            sieve.reject(row, f"sphere '{name}' is not in the artefact")
        elif radius < 0.0 or known <= 0.0:
            sieve.reject(row, "radius is missing" if radius == 0.0 else f"radius is {radius:g}")
        elif radius and abs(radius - known) > 1e-3:
            sieve.reject(row, f"radius {radius:g}, but the artefact says {known:g} mm for '{name}'")
        result.append(known + tips[row] + drift[row])
    return result


def _tip_radii(sieve: Sieve, artefact: Artefact | None) -> list[float]:
    """Radius of what touched, for each row, mm. A `tip_radius` other than the artefact's is rejected."""
    given, column = sieve.numbers("tip_radius", missing=0.0), sieve.data.texts("tip_radius")
    for row, radius in enumerate(given):
        if radius < 0.0:
            sieve.reject(row, f"tip_radius is {radius:g}")
        elif artefact and column[row] and abs(radius - artefact.tip_radius) > 1e-3:
            sieve.reject(row, f"tip_radius {radius:g}, but the artefact says {artefact.tip_radius:g} mm")
    return [artefact.tip_radius] * len(column) if artefact else given


def _rough_centres(artefact: Artefact | None, spheres: tuple[str, ...]) -> Floats | None:
    import numpy as np

    if artefact is None:
        return None
    found = [artefact.sphere(name) for name in spheres]
    return np.array([sphere.centre if sphere else [math.nan] * 3 for sphere in found], float)


def _spacings(artefact: Artefact | None, spheres: tuple[str, ...]) -> SpacingRows | None:
    """The certified distances between spheres that were touched."""
    import numpy as np

    from cellctl.calibration import SpacingRows

    used = [item for item in artefact.distances if set(item.between) <= set(spheres)] if artefact else []
    if not used:
        return None
    pairs = np.array([[spheres.index(name) for name in item.between] for item in used])
    return SpacingRows(pairs, np.array([item.mm for item in used]), np.array([[item.sigma] for item in used]))


def _sets(sieve: Sieve) -> list[str]:
    """The `set` column; once it is used, each row has to say `fit` or `test`."""
    sets = sieve.data.texts("set")
    if any(sets):
        for row, value in enumerate(sets):
            if value not in ("fit", "test"):
                sieve.reject(row, f"set '{value}' is neither fit nor test")
    return sets
