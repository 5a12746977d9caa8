"""`cellctl predict`: the TCP of an identified robot at given joints, and its uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments


def predict(
    model: Annotated[Path, typer.Argument(help="Model file, as `cellctl fit --out` writes it.")],
    joints: Annotated[Path, typer.Argument(help="CSV with A1…An (deg) or q1…qn (rad); other columns do not matter.")],
    out: arguments.Out = None,
    json_: arguments.Json = None,
    frame: Annotated[str, typer.Option(help="Frame of σ: base, or points (what was touched).")] = "base",
) -> None:
    """Predict the TCP at given joints: pose and 1 σ (3-D, mm).

    Output columns: A1…An, X, Y, Z, A, B, C, sigma, sigma_among, seen. seen: 1 within the joints of the fit, 0 outside
    (extrapolated, with a larger σ). sigma: in the model's base frame; touches do not determine its heading and height.
    With `--frame points` it is relative to what was touched, as in `cellctl compensate`; for a model from an instrument
    both are the same. sigma_among: of the rows relative to each other; empty for fewer than four rows. Optional columns
    temperature, payload, payload_x…z and D1…Dn give the conditions of each row. A payload between those of the fit is
    interpolated; one beyond them, or with another centre of gravity, is refused.

    Example: cellctl predict model.json joints.csv -o tcp.csv
    """
    from cellctl.cli.outputs import refuse_json_on_stdout, refuse_outputs, to_stdout, write_json
    from cellctl.files import write_atomically
    from cellctl.formats import DataSet, ModelFile
    from cellctl.operations.predicting import predict_rows

    refuse_json_on_stdout(json_, out, "the CSV")
    refuse_outputs({"--out": out, "--json": json_}, [model, joints])
    found = predict_rows(ModelFile.load(model), DataSet.load(joints), frame=frame)
    rows, outside = len(found.readings), int((~found.inside).sum())
    if out:
        write_atomically(out, found.text())
    else:
        to_stdout(found.text())
    write_json({"rows": rows, "outside_region": outside, "file": str(out) if out else None}, json_)
    if outside:
        seen = f"{outside} of {rows} rows lie outside the joints of the fit (seen = 0)"
        typer.echo(f"cellctl: {seen}: their σ is wider by what the model may be wrong by there", err=True)
    for words in found.assumed:
        typer.echo(f"cellctl: {words}", err=True)
