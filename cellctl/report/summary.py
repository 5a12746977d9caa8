"""The head of the page: what was run, how it ended, and its figures in one small table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.report.numbers import fixed
from cellctl.report.run import Run
from cellctl.report.words import mean_with_uncertainty

Section = dict[str, Any]

_ENDS = {"failed": "failed", "aborted": "was aborted", "uncertain": "ended uncertain: a person has to look at the cell"}


def head(run: Run) -> Section:
    """Title, state, sentence, and the rows of the table of figures."""
    sentence = str(run.verdict.get("sentence") or "")
    return {
        "title": _title(run),
        "run": run.folder.resolve().name,
        "simulated": run.simulated,
        "devices": [who.get("model", name) for name, who in run.state.identities.items()],
        "began": run.state.started.calendar if run.state.started else "",
        "end": _end(run),
        "good": run.word == "finished",
        "verdict": str(run.verdict.get("verdict") or ""),
        "sentence": sentence,
        "failures": _failures(run),
        "points": run.state.measurements,
        "figures": [*_held_out(run), *_standoff(run)],
    }


def _title(run: Run) -> str:
    if run.state.started is None:
        return "A run that never began"
    for line in run.state.started.procedure.text.splitlines():
        if line.startswith("title:"):
            return line.removeprefix("title:").strip().strip("\"'")
    return run.state.started.procedure.path


def _end(run: Run) -> str:
    """`This run was aborted: …`."""
    words = _ENDS.get(run.word) or f"{'was' if run.word.startswith('cut') else 'is'} {run.word}"
    reason = _reason(run)
    return f"This run {words}{': ' if reason else ''}{reason}"


def _reason(run: Run) -> str:
    return run.state.ended.reason if run.state.ended else ""


def _failures(run: Run) -> list[str]:
    """The steps whose last attempt did not end well, in words; what the reason says already is not repeated."""
    reason = _reason(run)
    failed = [(step.step, step.failure.text) for step in run.state.steps.values() if step.failure is not None]
    told = [f"{step}: {text}" if text not in reason else f"It happened in {step}." for step, text in failed]
    return told + [f"{step.step} had begun and did not end" for step in run.state.in_flight]


def _held_out(run: Run) -> list[Section]:
    figures = run.figures
    if not figures.get("n_test"):
        return []
    row = _row("held-out touches", int(figures["n_test"]), figures["nominal"], figures["test"])
    return [{**row, "predicted": fixed(figures.get("predicted_test_rms"))}]


def _standoff(run: Run) -> list[Section]:
    standoff = run.verdict.get("standoff")
    if not isinstance(standoff, Mapping) or not standoff.get("n"):
        return []
    row = _row("stand-off targets", int(standoff["n"]), standoff["before"], standoff["after"])
    return [{**row, "predicted": fixed(standoff.get("predicted_sigma"))}]


def _row(what: str, count: int, before: Mapping[str, float], after: Mapping[str, float]) -> Section:
    return {
        "what": what,
        "count": count,
        **{
            f"{when}_{name}": text
            for when, figures in (("before", before), ("after", after))
            for name, text in (
                ("mean", mean_with_uncertainty(figures["mean"], figures["rms"], count)),
                ("rms", fixed(figures["rms"])),
                ("max", fixed(figures["max"])),
            )
        },
    }
