"""Files of `cellctl plan`: the targets as CSV, ready to be a data set, and the path that targets are to be near to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cellctl.files import InputError, Problem
from cellctl.formats.columns import Sieve
from cellctl.formats.dataset import DataSet, text_of

if TYPE_CHECKING:
    from cellctl.kinematics import Floats
    from cellctl.planning import TargetSet

NOMINAL = tuple(f"nominal_{name}" for name in "XYZABC")
MEASURED = ("X", "Y", "Z")


def targets_text(targets: TargetSet) -> str:
    """CSV: name, A1…An (deg), nominal_X … nominal_C (mm, deg), set if some are held out, and empty X, Y, Z.

    The empty columns are for the measurement. The nominal ones have other names: a fit cannot take them for measured.
    """
    import numpy as np

    from cellctl.kinematics import abc_from_rotation

    nominal = np.column_stack([targets.poses[:, :3, 3], abc_from_rotation(targets.poses[:, :3, :3])])
    judged = bool(targets.held_out.any())
    axes = [f"A{number}" for number in range(1, targets.readings.shape[1] + 1)]
    digits = len(str(len(targets)))
    rows = []
    for number, (readings, place, test) in enumerate(
        zip(targets.readings.tolist(), np.round(nominal, 4).tolist(), targets.held_out.tolist(), strict=True), 1
    ):
        row = {"name": f"T{number:0{digits}}", **dict(zip(axes, readings, strict=True))}
        row |= dict(zip(NOMINAL, place, strict=True))
        rows.append(row | ({"set": "test" if test else "fit"} if judged else {}) | dict.fromkeys(MEASURED))
    return text_of(rows)


def read_path(file: Path) -> Floats:
    """Points (P, 3), mm, of a path from the columns X, Y, Z of a CSV.

    Raises InputError with every row that cannot be used, for fewer than two points, or a path without length.
    """
    import numpy as np

    data = DataSet.load(file)
    if missing := [name for name in MEASURED if not data.has(name)]:
        what = f"has no column {', '.join(missing)}"
        raise InputError(Problem(data.file, 1, 0, what, "X, Y, Z in mm: the TCP along the path"))
    sieve = Sieve(data)
    points = np.array([sieve.numbers(name) for name in MEASURED]).T
    if sieve.rejected():
        raise InputError(Problem(data.file, row.line, 0, row.reason) for row in sieve.rejected())
    if len(points) < 2 or np.ptp(points, axis=0).max() < 1e-6:
        raise InputError(Problem(data.file, 0, 0, "is no path: it has no length", "give two different points or more"))
    return points
