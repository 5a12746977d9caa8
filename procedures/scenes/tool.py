"""Contacts of the tool's measurement: errors with the taught tool and with the found one."""

from __future__ import annotations

import numpy as np

from cellctl.console.scene.run_points import Points, Role, SceneRun, SceneSource
from cellctl.kinematics import Floats
from procedures.steps.tool.rows import ToolErrorsRow, ToolPoseRow

TOOLS = ("taught tool", "found tool")


def tool_errors(run: SceneRun, n: int) -> tuple[Floats, Floats]:
    """Errors of the `n` contacts, in the order of measurement, with either tool (N,), mm; NaN: not found yet."""
    rows, _ = run.rows(ToolErrorsRow)
    if not rows or len(rows[-1]["taught"]) != n:
        return np.full(n, np.nan), np.full(n, np.nan)
    return np.abs(rows[-1]["taught"]), np.abs(rows[-1]["found"])


def points(run: SceneRun) -> list[Points]:
    """Poses with the tip at the fixed point; touches are those of the spheres."""
    rows, seq = run.rows(ToolPoseRow)
    if not rows:
        return []
    before, after = tool_errors(run, len(rows))
    at, label = run.setting.tcp([row["joints"] for row in rows]), [row["number"] for row in rows]
    group = Points.of("pose", Role.HELD_OUT, label, at, seq=seq, before=before, after=after, compared=TOOLS)
    return [group]


SOURCE = SceneSource(points=points)
