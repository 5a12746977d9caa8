"""Tables as text: a table file, and a controller's tables."""

from __future__ import annotations

from typing import Any

from cellctl.formats import TableFile
from cellctl.formats.table import JOINT_DECIMALS
from cellctl.formats.table_making import table_figures


def state_words(state: dict[str, Any]) -> str:
    """The tables of controller `serial`, one line each."""
    lines = [f"Controller {state['serial']}:"]
    for name, words in (("active", "in force"), ("previous", "before it"), ("staged", "staged")):
        info = state[name]
        lines.append(f"  {words:9}  " + (f"{info['id'][:12]}, {info['rows']} rows" if info else "none"))
    return "\n".join(lines)


def in_force_words(pushed: dict[str, Any]) -> str:
    """The result of a push."""
    return f"Table {pushed['id'][:12]} is in force on {pushed['serial']}: {pushed['rows']} rows, read back."


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
