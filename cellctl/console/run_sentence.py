"""A run in one sentence with its state, and its progress in words."""

from __future__ import annotations

from cellctl.console.live import Snapshot
from cellctl.console.look import State
from cellctl.console.run_words import look_of_verdict
from cellctl.operations.run_end import RunEnd

_ENDS: dict[str, State] = {"aborted": "warning"}
_NOW: dict[str, tuple[State, str]] = {
    "idle": ("working", "Beginning"),
    "checking": ("working", "Checking"),
    "connecting": ("working", "Connecting to the devices"),
    "running": ("working", "Running"),
    "paused": ("waiting", "Paused"),
    "cleaning": ("working", "Cleaning up"),
}


def sentence_of(now: Snapshot) -> tuple[State, str]:
    """State and sentence of a run: its verdict once there is one, else what it does or how it ended."""
    if now.problem and not now.events:
        return "bad", now.problem.what
    if now.active:
        return _active(now)
    if end := RunEnd.of(now.folder, now.state, running=False):
        return _ENDS.get(end.state, "bad"), end.sentence
    if now.sentence:
        return look_of_verdict(now.verdict, "good"), now.sentence
    return "good", "Finished."


def _active(now: Snapshot) -> tuple[State, str]:
    status = now.status
    state, word = _NOW.get(status.state, ("unknown", status.state))
    if status.state == "paused":
        return state, f"{word}: {status.held_by}" if status.held_by else f"{word}."
    if status.confirm:
        return "waiting", "Waits for a confirmation."
    if is_pausing(now):
        return "waiting", f"Pauses before the next step. Now: {status.phase or status.step}."
    if now.sentence:
        return look_of_verdict(now.verdict, "working"), f"{word}. So far: {now.sentence}"
    return state, f"{word}: {status.phase}." if status.phase else f"{word} …"


def is_pausing(now: Snapshot) -> bool:
    """Whether an operator has asked for a pause that has not begun: the step in progress ends first."""
    if not now.active or now.status.state != "running":
        return False
    for line in reversed(now.log):
        if line.kind == "state":
            return False
        if line.kind == "operator" and ", refused: " not in line.text and line.text.startswith(("pause", "resume")):
            return line.text.startswith("pause")
    return False


def progress_of(now: Snapshot) -> tuple[float, str]:
    """Share of the finished steps, from 0 to 1, and the progress in words."""
    status = now.status
    if not status.total:
        return 0.0, "The number of steps is not known yet." if now.active else ""
    share = min(1.0, status.done / status.total)
    left = f" · {_duration(status.left_s)} left" if status.left_s is not None and now.active else ""
    return share, f"{status.done} of {status.total} steps · {100 * status.done // status.total} %{left}"


def _duration(seconds: float) -> str:
    hours, rest = divmod(round(seconds), 3600)
    minutes, rest = divmod(rest, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
