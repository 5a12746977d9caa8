"""Runs compared: two side by side with their models, and the parameters of one robot over many, with trends."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from math import hypot, sqrt
from pathlib import Path
from typing import Any, final

import numpy as np
from pydantic import computed_field

from cellctl.calibration import RobotModel
from cellctl.calibration.verdict.agreement import Agreement
from cellctl.files import InputError
from cellctl.formats import ModelFile
from cellctl.journal import fold, read_journal
from cellctl.operations.agreement import DATA, models_agree, shared_rows
from cellctl.operations.comparing_models import (
    ComparedNumber,
    ModelDifference,
    determined,
    incomparable,
    model_difference,
    significant,
)
from cellctl.operations.run_indexing import MODEL
from cellctl.operations.run_list import ROBOT, RunSummary, run_summary
from cellctl.records import Figures, Json


@final
@dataclass(frozen=True, slots=True)
class ComparedFact:
    """A fact of both runs, as text."""

    name: str
    a: str
    b: str

    @computed_field
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
    """Runs a and b: names, facts and figures, and the difference of their models; None for the reason `why_not`.

    agreement: of the calibrations, by their own covariances; None for the reason `no_agreement`. notes: what else to
    know, a sentence each.
    """

    a: str
    b: str
    facts: tuple[ComparedFact, ...]
    figures: tuple[ComparedFigure, ...]
    models: ModelDifference | None
    why_not: str
    agreement: Agreement | None
    no_agreement: str
    notes: tuple[str, ...]


def compare_runs(a: Path, b: Path) -> RunComparison:
    """Compare two runs, by their folders. Raises JournalError if one has no readable journal."""
    rows = [run_summary(place, fold(read_journal(place))) for place in (a, b)]
    facts = tuple(ComparedFact(name, *(texts.get(name, "–") for texts in map(_facts, rows))) for name in _names(rows))
    models, why_not = _models(a, b)
    agreed, no_agreement = (None, why_not) if models is None else _agreement(a, b)
    figures, notes = tuple(_figures(*rows)), tuple(_notes(*rows))
    return RunComparison(a.name, b.name, facts, figures, models, why_not, agreed, no_agreement, notes)


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


def _agreement(a: Path, b: Path) -> tuple[Agreement | None, str]:
    """Whether the runs' calibrations agree, or why that cannot be said."""
    first, second = model_of(a), model_of(b)
    assert first is not None
    assert second is not None
    if shared := shared_rows(*(place / DATA for place in (a, b))):
        return None, f"{shared} rows are in the data sets of both: they would agree by these"
    try:
        return models_agree(first, second), ""
    except ValueError as error:
        return None, str(error)


def _notes(a: RunSummary, b: RunSummary) -> Iterator[str]:
    if a.serial != b.serial:
        yield "The robots are different: a difference of parameters is not a change of one robot."
    if not _same_kind(a, b):
        yield "The procedures are different: their errors before and after are not of the same kind."


def _same_kind(a: RunSummary, b: RunSummary) -> bool:
    return a.procedure_name == b.procedure_name


def _names(rows: Sequence[RunSummary]) -> list[str]:
    """The names of the facts of all rows, once each."""
    return list(dict.fromkeys(name for row in rows for name in _facts(row)))


def _facts(row: RunSummary) -> dict[str, str]:
    known = {
        "began": row.began,
        "procedure": row.procedure_name,
        "cell": Path(row.cell or "").stem,
        **{name: _identity(device) for name, device in _robot_first(row.devices)},
        "operator": row.operator,
        "state": row.state,
        "verdict": row.verdict,
        "points": row.points,
        "load": row.section.get("load"),
        "accuracy profile": row.section.get("accuracy"),
        "seed": row.seed,
        "table": f"{row.table['id'][:12]}, {row.table_state}" if row.table else None,
    }
    return {name: str(value) for name, value in known.items() if value not in (None, "")}


def _robot_first(devices: Mapping[str, Mapping[str, Json]]) -> list[tuple[str, Mapping[str, Json]]]:
    return sorted(devices.items(), key=lambda pair: pair[0] != ROBOT)


def _identity(device: Mapping[str, Json]) -> str:
    return f"{device.get('model', '')}, serial {device.get('serial', '')}".removeprefix(", ")


def _figures(a: RunSummary, b: RunSummary) -> Iterator[ComparedFigure]:
    for when, first, second in (("before", a.before, b.before), ("after", a.after, b.after)):
        if not first and not second:
            continue
        sigmas = [_sigma_of_mean(first, when, a), _sigma_of_mean(second, when, b)]
        for name in ("mean", "rms", "max"):
            known = name == "mean" and None not in sigmas and _same_kind(a, b)
            sigma = hypot(*(each or 0.0 for each in sigmas)) if known else None
            yield ComparedFigure(f"{when}, {name}", getattr(first, name, None), getattr(second, name, None), sigma)


def _sigma_of_mean(errors: Figures | None, when: str, row: RunSummary) -> float | None:
    """σ of the mean error, mm, from the scatter of its n errors; None where the result does not state n."""
    figures = errors and asdict(errors)
    for part in row.section.values():
        if figures and isinstance(part, Mapping) and part.get(when) == figures and int(part.get("n") or 0) > 1:
            return sqrt(max(figures["rms"] ** 2 - figures["mean"] ** 2, 0.0) / (part["n"] - 1))
    return None


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

    @computed_field
    @property
    def drifts(self) -> bool | None:
        """Whether the trend is above 2 σ; None without a trend."""
        return significant(self.slope, self.slope_sigma)


@final
@dataclass(frozen=True, slots=True)
class DatedRun:
    """Name and begin (UTC, ISO 8601) of a run."""

    run: str
    began: str


@final
@dataclass(frozen=True, slots=True)
class LeftOutRun:
    """Name of a run that is left out, and why."""

    run: str
    why: str


@final
@dataclass(frozen=True, slots=True)
class ParameterDrift:
    """Models of the robot `serial`, oldest first, and the runs that are left out."""

    serial: str
    runs: tuple[DatedRun, ...]
    parameters: tuple[ParameterSeries, ...]
    left_out: tuple[LeftOutRun, ...]


def parameter_drift(runs: Path, rows: Iterable[RunSummary], serial: str, names: Collection[str] = ()) -> ParameterDrift:
    """The drift of parameters of the robot `serial` over its runs among `rows`, in the folder `runs`.

    names: of the parameters; none: all that the rows of a model determine. Base and tool are left out: they change with
    the set-up. A model of another nominal robot than the latest one is left out.
    """
    own = sorted((row for row in rows if row.serial == serial), key=lambda row: (row.began or "", row.run))
    found: list[tuple[RunSummary, ModelFile]] = []
    left_out: list[LeftOutRun] = []
    for row in own:
        try:
            model = model_of(runs / row.run)
        except InputError as error:
            left_out.append(LeftOutRun(row.run, str(error)))
        else:
            found += [(row, model)] if model else []
    if not found:
        return ParameterDrift(serial, (), (), tuple(left_out))
    last = found[-1][1]
    left_out += [LeftOutRun(row.run, incomparable(model, last)) for row, model in found if incomparable(model, last)]
    found = [(row, model) for row, model in found if not incomparable(model, last)]
    dated = tuple(DatedRun(row.run, str(row.began)) for row, _ in found)
    series = _series([model for _, model in found], [each.began for each in dated], names)
    return ParameterDrift(serial, dated, series, tuple(left_out))


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
