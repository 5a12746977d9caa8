"""States, verdicts and times of runs as pages show them."""

from __future__ import annotations

from cellctl.console.look import State
from cellctl.operations.run_list import RunRow

_STATES: dict[str, State] = {
    "finished": "good",
    "aborted": "off",
    "failed": "bad",
    "uncertain": "bad",
    "unreadable": "bad",
    "paused": "waiting",
}
_VERDICTS: dict[str, State] = {
    "better": "good",
    "in control": "good",
    "measured": "good",
    "baseline": "off",
    "no better": "warning",
    "measure again": "warning",
    "worse": "bad",
    "recalibrate": "bad",
}


def look_of_state(row: RunRow) -> State:
    """How the state of a run looks."""
    word = str(row["state"])
    return _STATES.get(word) or ("bad" if word.startswith("cut off") else "working")


def look_of_verdict(word: object, other: State = "unknown") -> State:
    """How a verdict looks; other: a word that is none."""
    return _VERDICTS.get(str(word), other)


def shown_time(began: object) -> str:
    """`2026-11-21 19:24`, UTC; a dash without it."""
    return str(began)[:16].replace("T", " ") if began else "–"
