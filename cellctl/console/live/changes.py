"""Events of a run: what differs between two snapshots of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cellctl.console.live._run import Snapshot
from cellctl.console.live.events import Kind


def waits_for(now: Snapshot | None) -> str:
    """What a run in progress waits for a person to do; empty: it does not wait."""
    if now is None or not now.active:
        return ""
    if now.status.confirm:
        return now.status.confirm
    return (now.status.held_by or "paused") if now.status.state == "paused" else ""


def run_changes(before: Snapshot | None, now: Snapshot) -> Iterator[tuple[Kind, dict[str, Any]]]:
    """Kind and data of each event but the end, from `before` (None: not seen yet, or not in progress) to `now`."""
    status, run = now.status, {"run": now.run}
    if now.active and (before is None or not before.active):
        started = now.state.started
        yield (
            "run_started",
            {**run, "cell": started.cell.path if started else "", "operator": now.state.operator},
        )
        before = None
    old = before.status if before else None
    if old is None or (old.state, old.held_by) != (status.state, status.held_by):
        yield "run_state", {**run, "state": status.state, "held_by": status.held_by}
    if now.active and (old is None or old.step != status.step):
        yield "run_step", {**run, "step": status.step, "phase": status.phase}
    if now.active and (old is None or _percent(old.done, old.total) != _percent(status.done, status.total)):
        yield "run_progress", {**run, "done": status.done, "total": status.total, "left_s": status.left_s}
    if (waits := waits_for(now)) != waits_for(before):
        yield "run_waits", {**run, "for": waits, "step": status.step}


def _percent(done: int, total: int) -> int:
    """A long run changes its progress a hundred times, a short one with each step."""
    return 100 * done // total if total else 0
