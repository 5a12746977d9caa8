"""`cellctl predict`: the TCP of an identified robot at given joints, and its uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.calibration import Postures
    from cellctl.formats import ModelFile
    from cellctl.kinematics import Floats


def predict(
    model: Annotated[Path, typer.Argument(help="Model file, as `cellctl fit --out` writes it.")],
    joints: Annotated[Path, typer.Argument(help="CSV with A1…An (deg) or q1…qn (rad); other columns do not matter.")],
    out: arguments.Out = None,
    json_: arguments.Json = None,
) -> None:
    """Predict the TCP at given joints: pose and 1 σ (3-D, mm).

    Output columns: A1…An, X, Y, Z, A, B, C, sigma, sigma_among, seen. seen: 1 within the joints of the fit, 0 outside
    (extrapolated, with a larger σ). sigma: in the model's base frame; touches do not determine its heading and height.
    sigma_among: of the rows relative to each other; empty for fewer than four rows. Optional columns temperature,
    payload, payload_x…z and D1…Dn give the conditions of each row. A payload between those of the fit is interpolated;
    one beyond them, or with another centre of gravity, is refused.

    Example: cellctl predict model.json joints.csv -o tcp.csv
    """
    from cellctl.cli.outputs import refuse_json_on_stdout, refuse_outputs, to_stdout, write_json
    from cellctl.files import InputError, Problem, write_atomically
    from cellctl.formats import DataSet, ModelFile
    from cellctl.formats.columns import Sieve, joint_readings
    from cellctl.formats.measurements import Conditions

    refuse_json_on_stdout(json_, out, "the CSV")
    refuse_outputs({"--out": out, "--json": json_}, [model, joints])
    identified, data = ModelFile.load(model), DataSet.load(joints)
    sieve = Sieve(data)
    readings = joint_readings(sieve, identified.robot)
    conditions = Conditions(sieve, identified.robot, readings)
    if sieve.rejected():  # leaving some out would shift the others' lines
        raise InputError(Problem(data.file, row.line, 0, row.reason) for row in sieve.rejected())
    at = conditions.at(range(len(readings)))
    if refused := list(identified.load_region.refused(at) if identified.load_region else ()):
        raise InputError(Problem(data.file, data.lines[row], 0, reason, cure) for row, reason, cure in refused)
    text, extrapolated = _predicted(identified, readings, at)
    if out:
        write_atomically(out, text)
    else:
        to_stdout(text)
    write_json({"rows": len(readings), "outside_region": extrapolated, "file": str(out) if out else None}, json_)
    if extrapolated:
        seen = f"{extrapolated} of {len(readings)} rows lie outside the joints of the fit (seen = 0)"
        typer.echo(f"cellctl: {seen}: their σ is wider by what the model may be wrong by there", err=True)
    for words in _assumed(identified, at):
        typer.echo(f"cellctl: {words}", err=True)


def _predicted(model: ModelFile, readings: Floats, at: Postures) -> tuple[str, int]:
    """CSV of the predictions, and the number of rows outside the model's joint region."""
    import numpy as np

    from cellctl.formats.dataset import text_of
    from cellctl.kinematics import abc_from_rotation

    found, seen = model.predict(readings, at), model.inside(readings)
    values = np.column_stack(
        [readings, found.poses[:, :3, 3], abc_from_rotation(found.poses[:, :3, :3]), found.sigma_mm]
    )
    names = [*(f"A{number}" for number in range(1, model.robot.n + 1)), "X", "Y", "Z", "A", "B", "C", "sigma"]
    among = model.sigma_among(readings, at)
    rows = [
        {**dict(zip(names, row, strict=True)), "sigma_among": own, "seen": int(inside)}
        for row, own, inside in zip(np.round(values, 9).tolist(), _cells(among, len(readings)), seen, strict=True)
    ]
    return text_of(rows), int(np.count_nonzero(~seen))


def _assumed(model: ModelFile, at: Postures) -> list[str]:
    """Conditions for which the model has effects, and which the rows lack."""
    return [words for effect in model.robot_model().effects for words in effect.lacks(at)]


def _cells(sigma: Floats | None, rows: int) -> list[float | None]:
    return [None] * rows if sigma is None else [round(float(value), 9) for value in sigma]
