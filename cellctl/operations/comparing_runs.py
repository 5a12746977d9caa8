"""Two runs side by side: set-up, errors before and after, and the parameters of their models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import hypot, sqrt
from pathlib import Path
from typing import Any, final

from cellctl.files import InputError
from cellctl.formats import ModelFile
from cellctl.journal import fold, read_journal
from cellctl.operations.comparing_models import ModelDifference, ParameterChange, incomparable, model_difference
from cellctl.operations.run_list import ROBOT, RunRow, procedure_name, robot_serial
from cellctl.operations.run_summary import run_summary
from cellctl.operations.significance import ComparedNumber

MODEL = "model.json"


@final
@dataclass(frozen=True, slots=True)
class ComparedFact:
    """A fact of both runs, as text."""

    name: str
    a: str
    b: str

    @property
    def same(self) -> bool:
        """Whether it is the same in both."""
        return self.a == self.b


@final
@dataclass(frozen=True, slots=True)
class ComparedFigure(ComparedNumber):
    """A measured error of both runs, mm; None where a run has none. sigma: of the difference, None if not known.

    σ is that of a mean of n errors, from their scatter: it does not contain errors that all points of a run share.
    """

    name: str
    a: float | None
    b: float | None
    sigma: float | None


@final
@dataclass(frozen=True, slots=True)
class RunComparison:
    """Runs a and b: their rows, facts and figures, and the difference of their models; None for the reason `why_not`.

    notes: what else to know, a sentence each.
    """

    a: RunRow
    b: RunRow
    facts: tuple[ComparedFact, ...]
    figures: tuple[ComparedFigure, ...]
    models: ModelDifference | None
    why_not: str
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """As `cellctl show --against --json` shows it."""
        facts = [{**asdict(each), "same": each.same} for each in self.facts]
        figures = [_with_difference(each) for each in self.figures]
        models = None
        if self.models:
            changes = [_with_difference(each) for each in self.models.parameters]
            models = {**asdict(self.models), "parameters": changes, "sentence": self.models.sentence}
        names = {"a": self.a["run"], "b": self.b["run"]}
        return {
            **names,
            "facts": facts,
            "figures": figures,
            "models": models,
            "why_not": self.why_not,
            "notes": list(self.notes),
        }


def compare_runs(a: Path, b: Path) -> RunComparison:
    """Compare two runs, by their folders. Raises JournalError if one has no readable journal."""
    rows = [run_summary(place, fold(read_journal(place))) for place in (a, b)]
    facts = tuple(ComparedFact(name, *(texts.get(name, "–") for texts in map(_facts, rows))) for name in _names(rows))
    models, why_not = _models(a, b)
    return RunComparison(rows[0], rows[1], facts, tuple(_figures(*rows)), models, why_not, tuple(_notes(*rows)))


def model_of(place: Path) -> ModelFile | None:
    """The model of a run; None if it has none. Raises InputError if its file is damaged."""
    file = place / MODEL
    return ModelFile.load(file) if file.is_file() else None


def _models(a: Path, b: Path) -> tuple[ModelDifference | None, str]:
    """The difference of the runs' models, or why there is none."""
    try:
        first, second = model_of(a), model_of(b)
    except InputError as error:
        return None, str(error)
    without = [place.name for place, model in ((a, first), (b, second)) if model is None]
    if first is None or second is None:
        return None, f"no model was identified in {' and '.join(without)}"
    why = incomparable(first, second)
    return (None, why) if why else (model_difference(first, second), "")


def _notes(a: RunRow, b: RunRow) -> Iterator[str]:
    if robot_serial(a) != robot_serial(b):
        yield "The robots are different: a difference of parameters is not a change of one robot."
    if not _same_kind(a, b):
        yield "The procedures are different: their errors before and after are not of the same kind."


def _same_kind(a: RunRow, b: RunRow) -> bool:
    return procedure_name(a) == procedure_name(b)


def _names(rows: Sequence[RunRow]) -> list[str]:
    """The names of the facts of all rows, once each."""
    return list(dict.fromkeys(name for row in rows for name in _facts(row)))


def _facts(row: RunRow) -> dict[str, str]:
    table = row.get("table") or {}
    known = {
        "began": row.get("began"),
        "procedure": procedure_name(row),
        "cell": Path(row.get("cell") or "").stem,
        **{name: _identity(device) for name, device in _robot_first(row.get("devices") or {})},
        "operator": row.get("operator"),
        "state": row["state"],
        "verdict": row.get("verdict"),
        "points": row.get("points"),
        "load": row.get("load"),
        "accuracy profile": row.get("accuracy"),
        "seed": row.get("seed"),
        "table": f"{table['id'][:12]}, {row.get('table_state')}" if table else None,
    }
    return {name: str(value) for name, value in known.items() if value not in (None, "")}


def _robot_first(devices: Mapping[str, Any]) -> list[tuple[str, Any]]:
    return sorted(devices.items(), key=lambda pair: pair[0] != ROBOT)


def _identity(device: Mapping[str, Any]) -> str:
    return f"{device.get('model', '')}, serial {device.get('serial', '')}".removeprefix(", ")


def _figures(a: RunRow, b: RunRow) -> Iterator[ComparedFigure]:
    for when in ("before", "after"):
        first, second = (row.get(when) or {} for row in (a, b))
        if not first and not second:
            continue
        sigmas = [_sigma_of_mean(row, when) for row in (a, b)]
        for name in ("mean", "rms", "max"):
            known = name == "mean" and None not in sigmas and _same_kind(a, b)
            sigma = hypot(*(each or 0.0 for each in sigmas)) if known else None
            yield ComparedFigure(f"{when}, {name}", first.get(name), second.get(name), sigma)


def _sigma_of_mean(row: RunRow, when: str) -> float | None:
    """σ of the mean error, mm, from the scatter of its n errors; None where the result does not state n."""
    figures = row.get(when)
    for part in row.values():
        if figures and isinstance(part, Mapping) and part.get(when) == figures and int(part.get("n") or 0) > 1:
            return sqrt(max(figures["rms"] ** 2 - figures["mean"] ** 2, 0.0) / (part["n"] - 1))
    return None


def _with_difference(each: ComparedFigure | ParameterChange) -> dict[str, Any]:
    return {**asdict(each), "difference": each.difference, "significant": each.significant}
