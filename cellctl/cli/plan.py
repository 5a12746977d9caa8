"""`cellctl plan`: targets for a calibration, to be measured with any instrument."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import arguments
from cellctl.cli.plan_options import Asked

if TYPE_CHECKING:
    from cellctl.planning import TargetSet

_RANGES = "lower:upper for each, separated by commas; one number is a constant"


def plan(
    robot: arguments.Robot,
    n: Annotated[int, typer.Option("--n", min=1, help="Targets for the fit.")],
    method: Annotated[
        str,
        typer.Option(help="quasi-random, halton, joint-uniform, near-path; baselines: pseudo-random, clustered."),
    ] = "quasi-random",
    held_out: Annotated[int, typer.Option(min=0, help="Further targets for judging; adds the column set.")] = 0,
    box: Annotated[str | None, typer.Option(help=f"Ranges of X, Y, Z of the TCP, mm: {_RANGES}.")] = None,
    angles: Annotated[str | None, typer.Option(help="Ranges of A, B, C, deg, in the same form.")] = None,
    joints: Annotated[str | None, typer.Option(help="In place of --box: ranges of A1…An, deg.")] = None,
    path: Annotated[Path | None, typer.Option(help="CSV with X, Y, Z along the path, mm, for near-path.")] = None,
    dense: Annotated[
        int | None, typer.Option(min=1, help="Samples from which joint-uniform and near-path choose.")
    ] = None,
    partitions: Annotated[int | None, typer.Option(min=1, help="Parts of each joint, for joint-uniform.")] = None,
    near: Annotated[
        str | None, typer.Option(help="A1,…,An, deg: a posture in the configuration that all targets have.")
    ] = None,
    station: Annotated[
        str | None, typer.Option(help="X,Y,Z of the instrument, mm: targets are visible from it.")
    ] = None,
    reflector: Annotated[
        str | None, typer.Option(help="X,Y,Z of the reflector in the flange frame, mm. Default: the TCP.")
    ] = None,
    facing: Annotated[
        str | None, typer.Option(help="x,y,z: the reflector's direction in the flange frame. Default: turned by hand.")
    ] = None,
    acceptance: Annotated[
        float | None, typer.Option(help="Half angle within which it reflects, deg; with --facing. Default: 27.")
    ] = None,
    floor: Annotated[float | None, typer.Option(help="Height of the floor, mm; targets keep 100 mm from it.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed: the same one gives the same targets.")] = 0,
    out: arguments.Out = None,
    json_: arguments.Json = None,
) -> None:
    """Choose targets for a calibration with any instrument.

    Writes a CSV: joints A1…An, nominal pose of the TCP, and empty columns X, Y, Z. Measure, fill these in, and give the
    file to `cellctl fit`. Positions are in the frame of the robot file. Targets keep 5° from the joint limits.

    Example: cellctl plan kr5_r1400 --n 80 --box 850:1250,-300:300,200:600 --angles 0,180,0 -o targets.csv

    Varied orientation, even joints: --method joint-uniform --angles 85:95,75:105,60:120

    Near a path: --method near-path --n 500 --path path.csv
    """
    asked = Asked(
        method, n, held_out, box, angles, joints, path, dense, partitions, near, station, reflector, facing, acceptance,
        floor,
    )  # fmt: skip
    asked.refuse()
    from cellctl.cli.outputs import refuse_json_on_stdout, refuse_outputs, to_stdout, write_json
    from cellctl.files import write_atomically
    from cellctl.formats.targets import targets_text

    refuse_json_on_stdout(json_, out, "the CSV")
    refuse_outputs({"--out": out, "--json": json_}, [robot, path])
    targets = _targets(robot, asked, seed)
    if out:
        write_atomically(out, targets_text(targets))
        if json_ != "-":
            typer.echo(_words(targets, out))
    else:
        to_stdout(targets_text(targets))
    write_json({"method": method, "seed": seed, **_figures(targets), "file": str(out) if out else None}, json_)


def _targets(robot: Path, asked: Asked, seed: int) -> TargetSet:
    """The targets. Raises InputError where the options or the region do not allow them."""
    from cellctl.files import InputError
    from cellctl.formats import RobotFile
    from cellctl.operations.fit_options import option
    from cellctl.planning import OutOfReach, Reach, plan_targets

    file = RobotFile.load(robot)
    region, options = asked.region(file), asked.options(file)
    asked.raise_all()
    assert region is not None
    low, high = file.limits().T.tolist()
    reach = Reach(tuple(low), tuple(high))
    try:
        return plan_targets(
            file.chain(), file.joint_map(), reach, region, asked.method, asked.n, asked.held_out, seed, options  # type: ignore[arg-type]  # `Asked.refuse` has looked at the method
        )  # fmt: skip
    except (OutOfReach, ValueError) as error:
        what, _, cure = str(error).partition(": ")
        raise InputError(option("joints" if asked.joints else "box", what, cure)) from error


def _figures(targets: TargetSet) -> dict[str, Any]:
    import numpy as np

    axes = [f"A{number}" for number in range(1, targets.readings.shape[1] + 1)]
    fit = targets.readings[~targets.held_out]
    return {
        "n": int(np.count_nonzero(~targets.held_out)),
        "held_out": int(np.count_nonzero(targets.held_out)),
        "drawn": targets.drawn,
        "usable": targets.usable,
        "rejected": targets.rejected,
        "joints": {
            name: {"min": low, "max": high, "filled": share}
            for name, low, high, share in zip(
                axes, fit.min(axis=0).tolist(), fit.max(axis=0).tolist(), targets.filled.tolist(), strict=True
            )
        },
    }


def _words(targets: TargetSet, out: Path) -> str:
    figures = _figures(targets)
    judges = f" and {figures['held_out']} held-out" if figures["held_out"] else ""
    lines = [f"{out}: {figures['n']} targets{judges}, {figures['usable']} of {figures['drawn']} samples usable."]
    lines += [f"  rejected, {reason}: {count}" for reason, count in figures["rejected"].items() if count]
    spans = (
        f"  {name} {span['min']:.1f}…{span['max']:.1f}°, {100 * span['filled']:.0f} % of its parts filled"
        for name, span in figures["joints"].items()
    )
    lines += [*spans, "Fill in X, Y, Z as measured; add A, B, C if the instrument measures orientation."]
    return "\n".join(lines)
