"""The first two pages of a calibration report: who, what, with what, under which conditions, how good, how sure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from cellctl.devices.cell import ARTEFACT
from cellctl.formats import DataSet
from cellctl.journal import PushedTable
from cellctl.report._run import Run
from cellctl.report.acceptance import NAMES, RULE, Acceptance
from cellctl.report.budget import COVERAGE, NOT_STATED, Budget, Contribution, dimensions_of, scatter_of_fit
from cellctl.report.figures import fixed, significant

NOT_RECORDED = "not recorded"

_MOST = 3
"""Maximum number of different values listed of a column."""


def conditions_of(data: DataSet) -> list[tuple[str, str]]:
    """Name and text of each condition; `not recorded` if the data set has no such column."""
    named = [(name, _named(data, name)) for name in ("instrument", "serial", "operator", "date")]
    return [*named, ("temperature", temperature(data))]


def temperature(data: DataSet | None) -> str:
    """`21.0 … 23.5 °C`, from the column `temperature`."""
    found = [value for text in (data.texts("temperature") if data else []) if math.isfinite(value := _number(text))]
    if not found:
        return NOT_RECORDED
    low, high = fixed(min(found), 1), fixed(max(found), 1)
    return f"{low} °C" if low == high else f"{low} … {high} °C"


def _named(data: DataSet, column: str) -> str:
    values = list(dict.fromkeys(text for text in data.texts(column) if text))
    more = f", {len(values) - _MOST} more" if len(values) > _MOST else ""
    return ", ".join(values[:_MOST]) + more if values else NOT_RECORDED


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


_ROBOT = "robot"
"""The robot's name among the devices of a cell."""

Pairs = list[tuple[str, str]]


def summary(run: Run, environment: Mapping[str, str], budget: Budget | None, accepted: Acceptance) -> Mapping[str, Any]:
    """The data of the template."""
    return {
        "parties": _parties(run),
        "robot": _robot(run),
        "instruments": list(_instruments(run)),
        "environment": list(environment.items()),
        "procedure": _procedure(run),
        "acceptance": _acceptance(run, accepted),
        "decision": accepted,
        "rule": RULE,
        "region": _region(run),
        "budget": _budget_lines(budget) if budget else None,
        "sigma": run.figures.get("sigma_reason", "") if run.figures.get("sigma_ok") is False else "",
    }


def _parties(run: Run) -> Pairs:
    started, facts = run.state.started, run.facts
    recorded = started.operator if started else ""
    return [
        ("customer", facts.customer or NOT_STATED),
        ("site", facts.site or NOT_STATED),
        ("order", facts.order or NOT_STATED),
        ("operator", facts.operator or recorded or NOT_RECORDED),
        ("date", started.calendar if started else NOT_RECORDED),
    ]


def _robot(run: Run) -> Pairs:
    who, table = run.state.identities.get(_ROBOT, {}), PushedTable.of(run.state)
    tool = run.model.robot.tool if run.model else None
    return [
        ("robot", run.model.robot.name if run.model else str(who.get("model") or NOT_RECORDED)),
        ("serial", str(who.get("serial") or NOT_RECORDED) + (", simulated" if who.get("simulated") else "")),
        ("controller", str(who.get("firmware") or NOT_RECORDED)),
        ("tool, mm", ", ".join(f"{value:g}" for value in tool.xyz) if tool else NOT_RECORDED),
        ("compensation table", f"{table.row.id[:12]}, {table.state}" if table else "none"),
    ]


def _instruments(run: Run) -> Iterator[Mapping[str, str]]:
    """Every device but the robot, then the artefact: model, serial, last calibration, certificate."""
    for name, who in run.state.identities.items():
        if name != _ROBOT:
            serial = str(who.get("serial") or NOT_RECORDED) + (", simulated" if who.get("simulated") else "")
            yield {"name": name, "model": str(who.get("model") or NOT_RECORDED), "serial": serial} | _calibrated(
                run, name
            )
    if run.artefact is not None:
        spheres = run.artefact.spheres
        sizes = ", ".join(dict.fromkeys(f"{sphere.diameter:g}" for sphere in spheres))
        model = f"{len(spheres)} spheres, diameter {sizes} mm"
        yield {"name": ARTEFACT, "model": model, "serial": NOT_STATED} | _calibrated(run, ARTEFACT)


def _calibrated(run: Run, name: str) -> dict[str, str]:
    found = run.facts.calibrated.get(name)
    if found is None:
        return dict.fromkeys(("calibrated", "certificate"), NOT_STATED)
    serial = {"serial": found.serial} if found.serial else {}
    return {"calibrated": found.date, "certificate": found.certificate or NOT_STATED, **serial}


def environment_of(run: Run, found: Mapping[str, str]) -> Pairs:
    """Name and text of each condition; found: those that sections read."""
    known = dict.fromkeys(("air temperature", "air pressure", "relative humidity"), NOT_RECORDED)
    return list({**known, "robot temperature": temperature(run.data), **found}.items())


def _procedure(run: Run) -> Pairs:
    started, figures = run.state.started, run.figures
    if started is None:
        return [("procedure", NOT_RECORDED)]
    pairs = [
        ("procedure", run.title),
        ("file", f"{started.procedure.path.rpartition('/')[2]}, SHA-256 {started.procedure.sha256[:12]}"),
        ("measurements", str(run.state.measurements)),
    ]
    if figures:
        pairs.append(("identified from", f"{figures.get('n_fit', 0)}, judged by {figures.get('n_test', 0)} held out"))
        pairs.append(("model", f"{figures.get('model', '')}: {figures.get('n_parameters', '')} parameters"))
    return pairs


def _acceptance(run: Run, found: Acceptance) -> Pairs:
    name = NAMES[found.measurand]
    limit, figure = f"limit of the {name}", found.figure
    value = "none" if found.value_mm is None else f"{found.value_mm:.3f} mm, {_measured_with(run)}"
    pairs = [(limit, NOT_STATED if found.limit_mm is None else f"{found.limit_mm:g} mm"), (name, value)]
    if figure is None:
        return [*pairs, (f"U of the {name}, 95 %", NOT_STATED)]
    expanded = f"{significant(figure.expanded_mm)} mm (k = {fixed(figure.factor, 2)}, {figure.n} errors)"
    band = f"{significant(found.guard_band_mm)} mm ({found.guard:g} U)"
    return [*pairs, (f"U of the {name}, 95 %", expanded), ("guard band", band)]


def _measured_with(run: Run) -> str:
    table = PushedTable.of(run.state)
    active = table is not None and table.row.active
    return "measured with the compensation table in force" if active else "of held-out measurements, without a table"


def _region(run: Run) -> str:
    """The joint region of the identification: `A1 −51 … 45°, …`."""
    if run.model is None:
        return ""
    lower, upper = run.model.joint_region.min, run.model.joint_region.max
    each = (f"A{n} {fixed(a, 0)} … {fixed(b, 0)}°" for n, (a, b) in enumerate(zip(lower, upper, strict=True), 1))
    return ", ".join(each)


def budget_of(run: Run, of_sections: list[Contribution]) -> Budget | None:
    """None where the run identified nothing: its errors have no known uncertainty."""
    if not run.figures:
        return None
    dimensions = dimensions_of(str(run.figures.get("measure", "")))
    parts = [*_type_a(run, dimensions), *of_sections, *_type_b(run, dimensions)]
    return Budget.of(parts, dimensions, float(run.figures.get("radius_95", COVERAGE[3])))


def _type_a(run: Run, dimensions: int) -> Iterator[Contribution]:
    figures = run.figures
    fit, what = figures.get("fit"), "scatter of a measurement"
    rows, rank = int(figures.get("n_fit") or 0), int(figures.get("rank") or 0)
    found = scatter_of_fit(str(figures.get("measure", "")), fit["rms"], rows, rank) if fit else None
    if found is None:
        yield Contribution(what, "A", "residuals of the fit: too few")
    else:
        source = f"residuals of the fit, {found[1]} degrees of freedom; robot and instrument together"
        yield replace(Contribution.of_errors(what, "A", source, found[0], dimensions), shared=False)
    predicted = figures.get("predicted_volumetric_rms")
    if predicted is not None:
        # the scatter of the robot is in that of a measurement already: counted twice, the sum would be too large
        own = math.sqrt(max(float(predicted) ** 2 - float(figures.get("scatter_mm") or 0.0) ** 2, 0.0))
        source = "covariance of the fit, over its joints; points among themselves; without scatter"
        yield Contribution("identified parameters", "A", source, position_mm=own)


def _type_b(run: Run, dimensions: int) -> Iterator[Contribution]:
    stated = dict(run.facts.sigma_mm)
    distances = run.artefact.distances if run.artefact else []
    if distances and run.state.parameters.get("use_distances", True):
        greatest = max(distance.sigma for distance in distances)
        source = f"certificate: standard uncertainty up to {greatest:g} mm"
        yield Contribution("certified distances", "B", source, instead="in the fit")
    if run.artefact is not None:
        yield _stated("spheres and tip: diameter, form", stated.pop(ARTEFACT, None), dimensions)
    yield _stated("temperature: expansion of robot and set-up", stated.pop("temperature", None), dimensions)
    for name, sigma_mm in stated.items():
        yield _stated(name, sigma_mm, dimensions)


def _stated(what: str, sigma_mm: float | None, dimensions: int) -> Contribution:
    if sigma_mm is None:
        return Contribution(what, "B", "the cell file does not state it")
    return Contribution.of_errors(what, "B", "cell file, as stated by the operator", sigma_mm, dimensions)


def _budget_lines(budget: Budget) -> Mapping[str, Any]:
    """The table as text."""
    return {
        "lines": [
            {"what": each.what, "kind": each.kind, "source": each.source, "numbers": _numbers(each)}
            for each in budget.contributions
        ],
        "combined": [significant(budget.error_mm), significant(budget.position_mm)],
        "factors": [fixed(factor, 2) for factor in budget.factors],
        "expanded": [significant(value) for value in budget.expanded_mm],
        "along_a_line": budget.dimensions == 1,
        "missing": list(budget.missing),
    }


def _numbers(each: Contribution) -> list[str]:
    if each.error_mm is None and each.position_mm is None:
        return [each.instead, each.instead]
    return [significant(value) for value in (each.error_mm, each.position_mm)]
