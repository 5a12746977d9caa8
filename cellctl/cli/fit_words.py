"""A fit's result on the terminal: figures, unobservable parameters, mastering offsets, and the verdict last."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import typer

from cellctl.cli.ends import SHOWN

if TYPE_CHECKING:
    from rich.console import Console

_COMPARED = {
    "nominal": "nominal",
    "nominal_with_tool": "nominal with the tool registered",
    "prior": "prior model",
    "test": "identified",
}
_WIDTH = 80
_CAUSES = 5
_LETTERS = 160


def show(report: dict[str, Any]) -> None:
    """The figures as a table, unobservable parameters, mastering offsets, and the verdict as the last line."""
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    console.width = max(console.width, _WIDTH)  # a narrow terminal may fold a line, but not truncate a figure
    _figures(console, report)
    for words in (*_model(report), *_steps(report), *_unseen(report), *_far(report), *_mastering(report)):
        console.print(words, markup=False)
    console.print(report["sentence"], markup=False)


def name_rows(report: dict[str, Any]) -> None:
    """Every row that was not used, and held-out outliers, on stderr, by line; the JSON has them all."""
    named = [f"line {row['line']}: not used: {row['reason']}" for row in [*report["rejected"], *report["outliers"]]]
    named += [f"line {row['line']}: {row['reason']}" for row in report["test_outliers"]]
    for words in named[:SHOWN]:
        typer.echo(words, err=True)
    if len(named) > SHOWN:
        typer.echo(f"… and {len(named) - SHOWN} more such rows (--json names them all)", err=True)


def _figures(console: Console, report: dict[str, Any]) -> None:
    from rich.table import Table

    table = Table("distances, mm", box=None, pad_edge=False)
    for column in ("mean", "RMS", "max"):
        table.add_column(column, justify="right")
    compared = {key: name for key, name in _COMPARED.items() if report[key]}
    for key, name in compared.items():  # without held-out rows no row supports them
        table.add_row(f"held out, {name}", *(_cells(report[key]) if report["n_test"] else ["–"] * 3))
    table.add_row("rows of the fit", *_cells(report["fit"]))
    for label, figures in report["by"].items():
        for key, name in compared.items():
            table.add_row(f"  {label}, {name}", *_cells(figures[key]))
    console.print(table)


def _cells(figures: dict[str, float]) -> list[str]:
    return [f"{figures[figure]:.3f}" for figure in ("mean", "rms", "max")]


def _model(report: dict[str, Any]) -> Iterator[str]:
    seen = f"{report['rank']} of {report['n_parameters']} parameter combinations are observable"
    yield f"Model {report['model']}; {seen}; {report['n_fit']} rows to fit, {report['n_test']} held out."
    sure = f"{report['predicted_volumetric_rms']:.3f} mm (1 σ, 3-D, rigid motion removed)"
    yield f"Predicted over {report['predicted_over']}: {sure}."
    if report["prior"] and not report["informed"]:
        yield "The measured region is still that of the prior model: these rows determined places, not the robot."
    if not report["converged"]:
        yield f"Not converged: {report['ended']}."


def _steps(report: dict[str, Any]) -> Iterator[str]:
    """The models that were tried, each with its cross-validation error on rows of the fit."""
    for step in report["ladder"]:
        kept = "kept" if step["kept"] else "left out"
        gain = (
            f" (gain {step['gain_mm']:.2g} ± {step['standard_error_mm']:.2g} mm)" if step["standard_error_mm"] else ""
        )
        yield f"  {step['model']}: {kept}: {step['error_mm']:.3f} mm in cross-validation{gain}"


def _unseen(report: dict[str, Any]) -> Iterator[str]:
    """The reason, then the parameters: a line for each reason."""
    causes = report["unseen"]
    if causes:
        yield "Not observable with these rows:"
    for cause in causes[:_CAUSES]:
        yield f"  {': '.join([cause['cause'], *_shortly(cause['short'])])}"
    if len(causes) > _CAUSES:
        yield f"  and for {len(causes) - _CAUSES} more reasons (--json names them all)"


def _shortly(phrases: list[str]) -> list[str]:
    """The phrases that fit in one or two lines, at least the first; empty without phrases."""
    ends = [sum(len(phrase) + 2 for phrase in phrases[: count + 1]) for count in range(len(phrases))]
    count = max(sum(end <= _LETTERS for end in ends), 1)
    more = [f"and {len(phrases) - count} more"] if len(phrases) > count else []
    return ["; ".join([*phrases[:count], *more])] if phrases else []


def _far(report: dict[str, Any]) -> Iterator[str]:
    for row in report["wide"]:
        turns = row["unit"] == "rad"
        value, sigma, before = (_shown(row[key], turns) for key in ("value", "sigma", "tolerance"))
        unit = "°" if turns else f" {row['unit']}"
        yield f"  far from the robot file: {row['name']} {value}{unit} (1 σ {sigma}, expected within {before})"


def _shown(value: float, turns: bool) -> str:
    return f"{value * (57.29577951308232 if turns else 1.0):.4g}"


def _mastering(report: dict[str, Any]) -> Iterator[str]:
    if report["mastering"]:
        yield "Mastering: add to the controller's readings"
    for row in report["mastering"]:
        yield f"  {row['joint']}  {row['offset_deg']:+.4f}°  (1 σ {row['sigma_deg']:.4f}°)"
