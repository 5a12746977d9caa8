"""`cellctl prior`: what calibrated robots of one type tell of another one of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import Unwritten, refuse_outputs, write_json
from cellctl.cli.exit_codes import Exit
from cellctl.operations.type_priors import prior_of_type


def prior(
    given: Annotated[list[Path], typer.Argument(metavar="RUN…", help="Run folders or names, or model files.")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Write the prior to this file.")] = None,
    without: Annotated[
        list[str] | None, typer.Option(help="Leave out the robot with this serial, or this run (may be repeated).")
    ] = None,
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Make a prior of a type from the calibrations of its robots.

    `cellctl fit --prior-of-type` uses it: a further robot of the type then needs fewer rows.

    Ends with 0 where the robots have something in common, 1 where their rows show nothing of that kind, 2 where the
    input is wrong.

    Example: cellctl prior runs/sphere_selfcal-* -o kr5.json
    """
    refuse_outputs({"--out": out, "--json": json_}, given)
    found, unwritten = prior_of_type(given, runs, without or ()), Unwritten()
    if out:
        with unwritten.noted():
            found.save(out)
    with unwritten.noted():
        write_json(found.model_dump(), json_)
    if json_ != "-":
        for each in found.left_out:
            typer.echo(f"  {each.run}: left out: {each.why}")
        typer.echo(found.sentence())
    unwritten.refuse()
    if not found.supported:
        raise typer.Exit(Exit.NOT_BETTER)
