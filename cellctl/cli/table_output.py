"""A compensation table as text on the terminal, and as files with the text that says where they go."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cellctl.cli.arguments import refuse_json_on_stdout, refuse_outputs, to_stdout
from cellctl.devices import TableState
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import TableFile
from cellctl.formats.table import JOINT_DECIMALS
from cellctl.formats.table_export import krl_module, module_name, nominal_name, targets_csv
from cellctl.formats.table_making import table_figures
from cellctl.operations.table import Pushed, RolledBack


def state_words(serial: str, state: TableState | RolledBack) -> str:
    """The tables of controller `serial`, one line each."""
    lines = [f"Controller {serial}:"]
    for info, words in ((state.active, "in force"), (state.previous, "before it"), (state.staged, "staged")):
        lines.append(f"  {words:9}  " + (f"{info.id[:12]}, {info.rows} rows" if info else "none"))
    return "\n".join(lines)


def in_force_words(pushed: Pushed) -> str:
    """The result of a push."""
    return f"Table {pushed.id[:12]} is in force on {pushed.serial}: {pushed.rows} rows, read back."


def table_words(table: TableFile) -> str:
    """A table file in a few lines."""
    figures = table_figures(table)
    before, after, sigma = (figures[name] for name in ("predicted_before_mm", "predicted_after_mm", "sigma_mm"))
    kind = "a simulated" if table.simulated else "a real"
    return "\n".join(
        [
            f"Table {table.id}",
            f"  for        {table.robot.name}, {kind} controller, serial {table.robot.serial}",
            f"  made       {table.created}, {table.source.method}, run {table.source.run or '-'}",
            f"  rows       {figures['rows']}, joints corrected by up to {figures['max_correction_deg']:.3f}°",
            f"  predicted  error {before['mean']:.3f} mm with nominal joints, {after['mean']:.4f} with these (mean)",
            f"  joints     with {JOINT_DECIMALS} decimals of a degree, as the controller takes them",
            "  σ          "
            + (f"{sigma['rms']:.3f} mm (RMS), {sigma['max']:.3f} mm (max)" if sigma else "none: of another predictor"),
        ]
    )


_PLACES = """\
{files} in {folder}: table {id}, {rows} rows, for {robot}, serial {serial}.
  Load both   KRC:\\R1\\Program\\ (user group Expert), or KRC/R1/Program of a WorkVisual project.
  Use         {name}(N) after the INI of your program moves point to point to row N; {nominal}(N) to its nominal joints.
  Before      The rows are joints: the tool on the flange must be that of the table.
  First       T1, override 10 %, row by row. Not tried on a real controller.
{simulated}"""

_SIMULATED = "  SIMULATED   The table is of a simulated robot: both routines stop at HALT.\n"


def refuse_export(table: Path, krl: bool, csv: bool, out: Path | None, json_: str | None) -> None:
    """Raise InputError for options that contradict each other, or an output that cannot be written."""
    if krl == csv:
        raise InputError(Problem("cellctl table export", 0, 0, "writes one form", "give --krl or --csv"))
    refuse_outputs({"--json": json_} if krl else {"-o": out, "--json": json_}, [table])
    if csv:
        refuse_json_on_stdout(json_, out, "the CSV")


def export_krl(table: TableFile, folder: Path) -> tuple[dict[str, Any], str]:
    """Write the KRL module to `folder` (CR LF); the result as data and in words. Raises InputError, OSError."""
    if str(folder) == "-" or (folder.exists() and not folder.is_dir()):
        raise InputError(Problem(str(folder), 0, 0, "is no folder", "give -o a folder: the KRL module has two files"))
    made = krl_module(table)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in made.items():
        write_atomically(folder / name, text.replace("\n", "\r\n"))
    result = {"id": table.id, "folder": str(folder), "files": list(made), "rows": len(table.rows)}
    words = _PLACES.format(
        files=" and ".join(made),
        folder=folder,
        id=table.id[:12],
        rows=len(table.rows),
        robot=table.robot.name,
        serial=table.robot.serial,
        name=module_name(table),
        nominal=nominal_name(table),
        simulated=_SIMULATED if table.simulated else "",
    )
    return result, words.rstrip("\n")


def export_csv(table: TableFile, out: Path | None) -> tuple[dict[str, Any], str]:
    """Write the targets as CSV to `out` or stdout; the result, and words for a file."""
    text = targets_csv(table)
    result = {"id": table.id, "file": str(out) if out else None, "rows": len(table.rows)}
    if out is None:
        to_stdout(text)
        return result, ""
    write_atomically(out, text)
    return result, f"{len(table.rows)} targets of table {table.id[:12]} in {out}: nominal and compensated joints, deg."
