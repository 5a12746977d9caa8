"""`cellctl compensate --method all`: the compensation methods side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import typer

from cellctl.cli.ends import SHOWN
from cellctl.cli.outputs import write_json

if TYPE_CHECKING:
    from rich.table import Table

    from cellctl.formats import ModelFile
    from cellctl.formats.targets import Targets
    from cellctl.operations.compensating import Accuracy, MethodFigures

_WIDTH = 120
_SHOWN_PASSES = 5


def compare(model: ModelFile, wanted: Targets, file: str, correction_deg: float, json_: str | None) -> None:
    """Print every method's figures on the targets `wanted`, of `file`, or write them as JSON."""
    from cellctl.operations.compensating import compare_methods

    found = compare_methods(model, wanted, file, correction_deg)
    if json_ != "-":
        _show(found, file)
    write_json({"file": file, "targets": len(wanted.lines), "methods": [each.dump() for each in found]}, json_)


def _show(found: Sequence[MethodFigures], file: str) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    console.width = max(console.width, _WIDTH)  # a narrow terminal may fold a line, but not truncate a figure
    console.print(_accuracies(found))
    if any(each.reached for each in found):
        console.print()
        console.print(_passes(found))
    for words in _notes(found):
        console.print(words, markup=False, soft_wrap=True)
    named = list(dict.fromkeys(pair for each in found for pair in each.unreached))
    for line, reason in named[:SHOWN]:
        typer.echo(f"{file}:{line}: {reason}", err=True)
    if len(named) > SHOWN:
        typer.echo(f"… and {len(named) - SHOWN} more (--json names them all)", err=True)


def _accuracies(found: Sequence[MethodFigures]) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column("predicted error", no_wrap=True)
    figures = ("mean µm", "RMS", "max", "mean °")
    passes = [f"{form}\n{figure}" for form in ("1 pass", "repeated") for figure in figures]
    for column in ("reached", *passes, "µs per\ntarget"):
        table.add_column(column, justify="right", no_wrap=True)
    if before := next((each.before for each in found if each.before), None):
        table.add_row("nominal joints", "", *_cells(before))
    for each in found:
        repeated = _cells(each.iterated) if each.repeats else ["–"] * 4
        counts, spent = f"{each.reached}/{each.targets}", f"{1e6 * each.seconds_per_target:.0f}"
        table.add_row(each.method, counts, *_cells(each.one_pass), *repeated, spent)
    return table


def _cells(accuracy: Accuracy | None) -> list[str]:
    if accuracy is None:
        return ["–"] * 4
    lengths = [f"{1000.0 * accuracy.position_mm[name]:.4g}" for name in ("mean", "rms", "max")]
    return [*lengths, f"{accuracy.orientation_deg['mean']:.2g}"]


def _passes(found: Sequence[MethodFigures]) -> Table:
    """Mean error before the first pass and after each: figure 5 of the comparison that the methods are from."""
    from rich.table import Table

    most = min(max((len(each.per_pass_mm) for each in found), default=0), _SHOWN_PASSES + 1)
    table = Table(box=None, pad_edge=False)
    table.add_column("mean error, µm, after pass", no_wrap=True)
    for number in range(most):
        table.add_column(str(number), justify="right", no_wrap=True)
    for each in found:
        if each.repeats:
            table.add_row(each.method, *(f"{1000.0 * value:.3g}" for value in each.per_pass_mm[:most]))
    return table


def _notes(found: Sequence[MethodFigures]) -> Iterator[str]:
    if names := [each.method for each in found if each.position_only]:
        yield f"{', '.join(names)}: position only; the orientation is the nominal robot's."
    if names := [each.method for each in found if not each.repeats]:
        yield f"{', '.join(names)}: parameters in the controller; what is left is the rest of the model."
