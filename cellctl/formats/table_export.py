"""Compensated targets for people who load them by hand: a table as a KRL module and as CSV; targets as CSV."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.formats.dataset import text_of
from cellctl.formats.model import ModelFile
from cellctl.formats.table import Row, TableFile
from cellctl.formats.table_making import nominal_chain
from cellctl.kinematics import abc_from_rotation
from cellctl.krl.writing import aggregate_text, data_list, declaration_text, program

_MOST_AXES = 6
_POSE = ("X", "Y", "Z", "A", "B", "C")


def module_name(table: TableFile) -> str:
    """The name of the KRL module: `CT_` and the first digits of the table's id."""
    return f"CT_{table.id[:12].upper()}"


def nominal_name(table: TableFile) -> str:
    """The name of the routine that moves to the nominal joints."""
    return f"CN{module_name(table)[2:]}"


def krl_module(table: TableFile) -> dict[str, str]:
    """File name → text of the module, LF line ends: data list with the joints of each row, and a program for them.

    `CT_…(N)` moves point to point to row N with compensated joints, `CN_…(N)` with nominal joints. Both stop on another
    controller; those of a simulated robot always stop. External axes stay where they are. Raises InputError for a robot
    with more than six axes.
    """
    name = module_name(table)
    axes = len(table.rows[0].nominal)
    if axes > _MOST_AXES:
        what = f"has {axes} axes, a KUKA robot at most {_MOST_AXES}"
        raise InputError(Problem(table.id[:12], 0, 0, what, "export it with --csv"))
    comments = _comments(table, name)
    routines = [_routine(table, name, "COMPENSATED"), "", _routine(table, nominal_name(table), "NOMINAL")]
    return {f"{name}.dat": data_list(name, _data(table), comments), f"{name}.src": program(routines, comments)}


def _data(table: TableFile) -> list[str]:
    count = len(table.rows)
    lines = [f"DECL INT ROWS={count}"]
    arrays = {"COMPENSATED": [row.compensated for row in table.rows], "NOMINAL": [row.nominal for row in table.rows]}
    for array, joints in arrays.items():
        lines.append(declaration_text("E6AXIS", array, rows=count))
        lines += [f"{array}[{place}]={aggregate_text(_axes(values))}" for place, values in enumerate(joints, 1)]
    return lines


def _routine(table: TableFile, name: str, array: str) -> str:
    """A routine that moves to row N. HALT in a loop: the start key does not take the program past it."""
    head = f"DEF {name}( N:IN )" if array == "COMPENSATED" else f"GLOBAL DEF {name}( N:IN )"
    return "\n".join([head, "DECL INT N", *_guard(table), *_stop_if("(N<1) OR (N>ROWS)"), f"PTP {array}[N]", "END"])


def _guard(table: TableFile) -> list[str]:
    serial = table.robot.serial
    if table.simulated:
        return ["; Made for a simulated robot: it stops here.", *_stop_if("TRUE")]
    if not (serial.isascii() and serial.isdigit()):
        return ["; The serial of the table is no number: it is not compared with $KR_SERIALNO."]
    return _stop_if(f"$KR_SERIALNO<>{int(serial)}")


def _stop_if(condition: str) -> list[str]:
    return [f"IF {condition} THEN", "  LOOP", "    HALT", "  ENDLOOP", "ENDIF"]


def _comments(table: TableFile, name: str) -> list[str]:
    tool = table.tool
    pose = ", ".join(f"{label} {value:g}" for label, value in zip(_POSE, (*tool.xyz, *tool.abc), strict=True))
    return [
        f"{name}: compensated joints of cellctl table {table.id}",
        f"Robot {table.robot.name}, controller serial {table.robot.serial}{', SIMULATED' if table.simulated else ''}",
        f"Tool {pose} (mm, deg), {table.payload:g} kg. $TOOL is not used: the rows are joints, 6 decimals",
        f"Run {table.source.run or 'none'}, method {table.source.method}, created {table.created}",
        f"{len(table.rows)} rows. {name}(N) moves to row N. Not tried on a real controller.",
    ]


def targets_csv(table: TableFile) -> str:
    """Targets, joints and predicted errors as CSV, one line for each row.

    Columns: `row`; X, Y, Z, mm, A, B, C, deg, of the TCP in the model's frame; `nominal_A1`…, `compensated_A1`…, deg;
    `predicted_before_mm`, `predicted_after_mm`, `sigma_mm`.
    """
    return text_of(
        [
            {
                "row": place,
                **_pose(row.target),
                **_axes(row.nominal, "nominal_"),
                **_axes(row.compensated, "compensated_"),
                **_figures(row),
            }
            for place, row in enumerate(table.rows, 1)
        ]
    )


def compensated_csv(model: ModelFile, rows: list[Row]) -> str:
    """CSV with a line for each row: target, compensated joints, pseudo-target, nominal joints, predicted errors, σ."""
    return text_of(compensated_records(model, rows))


def compensated_records(model: ModelFile, rows: list[Row]) -> list[dict[str, float | None]]:
    """The lines of the CSV, by column; the target's six columns are the first."""
    return [
        {
            **_pose(row.target),
            **_axes(row.compensated),
            **_pose(sent, "pseudo_"),
            **_axes(row.nominal, "nominal_"),
            **_figures(row),
        }
        for row, sent in zip(rows, _pseudo_targets(model, rows), strict=True)
    ]


def _pose(values: Sequence[float], prefix: str = "") -> dict[str, float]:
    return {f"{prefix}{name}": value for name, value in zip(_POSE, values, strict=True)}


def _axes(values: Sequence[float], prefix: str = "") -> dict[str, float]:
    return {f"{prefix}A{place}": value for place, value in enumerate(values, 1)}


def _figures(row: Row) -> dict[str, float | None]:
    names = ("predicted_before_mm", "predicted_after_mm", "sigma_mm")
    return {name: getattr(row, name) for name in names}


def _pseudo_targets(model: ModelFile, rows: list[Row]) -> list[list[float]]:
    """Where a controller with nominal kinematics believes its TCP at the compensated joints: X, Y, Z, A, B, C."""
    readings = np.array([row.compensated for row in rows])
    poses = nominal_chain(model).forward(model.robot.joint_map().model(readings))
    found = np.hstack([poses[:, :3, 3], abc_from_rotation(poses[:, :3, :3])]).round(9) + 0.0  # no minus zero
    return [list(map(float, row)) for row in found]
