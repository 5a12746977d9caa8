"""Parameters of one robot's models over the runs that identified them, with their trends."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from cellctl.files import InputError
from cellctl.operations.comparing_models import determined, incomparable
from cellctl.operations.comparing_runs import model_of
from cellctl.operations.run_list import RunRow, robot_serial
from cellctl.operations.significance import significant

if TYPE_CHECKING:
    from cellctl.calibration import RobotModel
    from cellctl.formats import ModelFile

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
