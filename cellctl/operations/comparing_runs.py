"""Runs compared: two side by side with their models, and the parameters of one robot over many, with trends."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from math import hypot, sqrt
from pathlib import Path
from typing import Any, final

import numpy as np

from cellctl.calibration import RobotModel
from cellctl.files import InputError
from cellctl.formats import ModelFile
from cellctl.journal import fold, read_journal
from cellctl.operations.comparing_models import (
    ComparedNumber,
    ModelDifference,
    ParameterChange,
    determined,
    incomparable,
    model_difference,
    significant,
)
from cellctl.operations.run_list import ROBOT, RunRow, procedure_name, robot_serial, run_summary

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


_DAYS = 30.0
"""A trend is stated for as many days."""


@final
@dataclass(frozen=True, slots=True)
class ParameterSeries:
    """A parameter in each of R runs, in `unit` as shown to people; None where a model does not have it.

    values, sigmas (R,): deviation from nominal and 1 σ. slope, slope_sigma: trend for 30 days, weighted by σ, its own σ
    widened where the values scatter more than σ; None for fewer than three determined values, or all of one day.
    """

    name: str
    label: str
    unit: str
    values: tuple[float | None, ...]
    sigmas: tuple[float | None, ...]
    slope: float | None = None
    slope_sigma: float | None = None

    @property
    def drifts(self) -> bool | None:
        """Whether the trend is above 2 σ; None without a trend."""
        return significant(self.slope, self.slope_sigma)


@final
@dataclass(frozen=True, slots=True)
class ParameterDrift:
    """Models of the robot `serial`, oldest first. runs: name and begin (ISO 8601); left_out: name, and why."""

    serial: str
    runs: tuple[tuple[str, str], ...]
    parameters: tuple[ParameterSeries, ...]
    left_out: tuple[tuple[str, str], ...]

    def to_json(self) -> dict[str, Any]:
        """As JSON has it."""
        runs = [{"run": name, "began": began} for name, began in self.runs]
        left_out = [{"run": name, "why": why} for name, why in self.left_out]
        parameters = [{**asdict(each), "drifts": each.drifts} for each in self.parameters]
        return {"serial": self.serial, "runs": runs, "parameters": parameters, "left_out": left_out}


def parameter_drift(runs: Path, rows: Iterable[RunRow], serial: str, names: Collection[str] = ()) -> ParameterDrift:
    """The drift of parameters of the robot `serial` over its runs among `rows`, in the folder `runs`.

    names: of the parameters; none: all that the rows of a model determine. Base and tool are left out: they change with
    the set-up. A model of another nominal robot than the latest one is left out.
    """
    own = sorted(
        (row for row in rows if robot_serial(row) == serial), key=lambda row: (str(row.get("began") or ""), row["run"])
    )
    found: list[tuple[RunRow, ModelFile]] = []
    left_out: list[tuple[str, str]] = []
    for row in own:
        try:
            model = model_of(runs / row["run"])
        except InputError as error:
            left_out.append((row["run"], str(error)))
        else:
            found += [(row, model)] if model else []
    if not found:
        return ParameterDrift(serial, (), (), tuple(left_out))
    last = found[-1][1]
    left_out += [(row["run"], incomparable(model, last)) for row, model in found if incomparable(model, last)]
    found = [(row, model) for row, model in found if not incomparable(model, last)]
    began = [str(row["began"]) for row, _ in found]
    series = _series([model for _, model in found], began, names)
    return ParameterDrift(serial, tuple((row["run"], str(row["began"])) for row, _ in found), series, tuple(left_out))


def _series(models: Sequence[ModelFile], began: Sequence[str], names: Collection[str]) -> tuple[ParameterSeries, ...]:
    robots = [model.robot_model() for model in models]
    known = {each.name: each for robot in robots for each in robot.parameters if each.group not in ("base", "tool")}
    chosen = [name for name in known if name in names] or sorted(_determined(models, known), key=list(known).index)
    days = _days(began)
    return tuple(_one(name, robots, models, days) for name in chosen)


def _determined(models: Sequence[ModelFile], known: Collection[str]) -> set[str]:
    return {each.name for model in models for each in model.parameters if each.name in known and determined(each)}


def _one(name: str, robots: Sequence[RobotModel], models: Sequence[ModelFile], days: Any) -> ParameterSeries:
    about = next(each for robot in robots for each in robot.parameters if each.name == name)
    stored = [next((each for each in model.parameters if each.name == name), None) for model in models]
    factor = about.unit.factor
    values = tuple(each.value * factor if each and each.prior_sigma > 0.0 else None for each in stored)
    sigmas = tuple(each.sigma * factor if each and each.prior_sigma > 0.0 else None for each in stored)
    sure = np.array([each is not None and determined(each) for each in stored])
    slope = _slope(days[sure], np.array(values, float)[sure], np.array(sigmas, float)[sure])
    return ParameterSeries(name, about.label, about.unit.shown, values, sigmas, *slope)


def _slope(days: Any, values: Any, sigmas: Any) -> tuple[float | None, float | None]:
    """Trend for 30 days and its σ, by weighted least squares."""
    if len(days) < 3 or np.ptp(days) < 1.0:
        return None, None
    columns = np.stack([np.ones_like(days), days / _DAYS], axis=1) / sigmas[:, None]
    covariance = np.linalg.inv(columns.T @ columns)
    found = covariance @ columns.T @ (values / sigmas)
    chi2 = float(np.sum((values / sigmas - columns @ found) ** 2))
    wider = max(1.0, chi2 / (len(days) - 2))
    return float(found[1]), float(np.sqrt(covariance[1, 1] * wider))


def _days(began: Sequence[str]) -> Any:
    """Days (R,) since the first begin."""
    instants = [datetime.fromisoformat(each) for each in began]
    return np.array([(each - instants[0]).total_seconds() / 86400.0 for each in instants])
