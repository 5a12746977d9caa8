"""`/compare`: two runs side by side, and the drift of one robot's parameters."""

from __future__ import annotations

import asyncio
from typing import Any, final
from urllib.parse import urlencode

from nicegui import ui

from cellctl.console.appearance import (
    INKS,
    command_button,
    figures,
    look_of_verdict,
    numbers,
    problem_list,
    section,
    state_word,
    words,
)
from cellctl.console.charts import drift_chart
from cellctl.console.commands import found_rows, indexed
from cellctl.console.frame import frame
from cellctl.console.shared import console
from cellctl.files import InputError
from cellctl.journal import JournalError
from cellctl.operations.comparing_models import ModelDifference, ParameterChange
from cellctl.operations.comparing_runs import (
    ParameterDrift,
    ParameterSeries,
    RunComparison,
    compare_runs,
    parameter_drift,
)
from cellctl.operations.results import Failure
from cellctl.operations.run_folder import run_named
from cellctl.operations.run_indexing import summary_of
from cellctl.report.figures import agreement_lines, fixed, with_sigma
from cellctl.run_index import RunFilter

_MOST_CHARTS = 12

_OFFERED = 50
"""Number of runs that a field offers; more words find others."""


@ui.page("/compare", response_timeout=30.0)
async def compare(a: str = "", b: str = "") -> None:
    """Two runs side by side."""
    offered = await _offered()
    with frame("Compare runs", "/runs"):
        _choice(offered, a, b)
        if a and b:
            await _comparison(a, b)
        await _drift(a)


async def _offered(text: str = "") -> list[str]:
    """The newest runs with these words in what is known of them."""
    return [row.run for row in await found_rows(RunFilter(text=text), limit=_OFFERED)]


def _with(chosen: str | None, names: list[str]) -> list[str]:
    return names if not chosen or chosen in names else [chosen, *names]


def _choice(names: list[str], a: str, b: str) -> None:
    async def typed(field: ui.select, text: str) -> None:
        field.set_options(_with(field.value, await _offered(text)))

    def both() -> None:
        ui.navigate.to(f"/compare?{urlencode({'a': first.value or '', 'b': second.value or ''})}")

    def turned() -> None:
        ui.navigate.to(f"/compare?{urlencode({'a': second.value or '', 'b': first.value or ''})}")

    with ui.element("div").classes("row search"):
        first, second = (
            ui.select(_with(value, names), label=label, value=value or None, with_input=True)
            .props("outlined dense input-debounce=250")
            .classes("grow")
            for label, value in (("Run a", a), ("Run b", b))
        )
        for field in (first, second):
            field.on("input-value", lambda event, field=field: typed(field, str(event.args or "")))
        command_button("Compare", both, important=True)
        command_button("Exchange", turned, icon="swap_horiz")


async def _comparison(a: str, b: str) -> None:
    try:
        first, second = (run_named(console().runs, name) for name in (a, b))
        found = await asyncio.to_thread(compare_runs, first, second)
    except (InputError, JournalError) as error:
        problem_list(Failure.of(error).problems)
        return
    for note in found.notes:
        state_word("warning", note)
    with ui.element("div").classes("columns"):
        _errors(found)
        _facts(found)
    with section("Parameters of the models"):
        if found.models is None:
            ui.label(f"Not compared: {found.why_not}.").classes("note")
        else:
            _agreement(found)
            _models(found.models)


def _facts(found: RunComparison) -> None:
    rows = [[fact.name, fact.a, fact.b, "" if fact.same else "differs"] for fact in found.facts]
    marked = frozenset(number for number, fact in enumerate(found.facts) if not fact.same)
    with section("Set-up").classes("wrapping"):
        figures(words("Part", "a", "b", "Difference"), rows, label="Set-up", marked=marked)


def _errors(found: RunComparison) -> None:
    rows = [
        [
            each.name,
            fixed(each.a),
            fixed(each.b),
            _difference(each.difference, each.sigma),
            _significance(each.significant),
        ]
        for each in found.figures
    ]
    note = "σ: from the scatter of the errors. It does not contain what all points of a run share."
    with section("Held-out errors, mm", note=note):
        columns = [*words("Error"), *numbers("a", "b", "b − a, ± 1 σ"), *words("above 2 σ")]
        figures(columns, rows, label="Errors")


def _agreement(found: RunComparison) -> None:
    agreed = found.agreement
    if agreed is None:
        ui.label(f"Whether the calibrations agree is not judged: {found.no_agreement}.").classes("note")
        return
    state_word(look_of_verdict(agreed.verdict), agreed.sentence)
    for line in agreement_lines(agreed):
        ui.label(line).classes("note")


def _models(models: ModelDifference) -> None:
    state_word("warning" if models.differ else "good", models.sentence)
    if models.tcp_rms_mm is not None:
        ui.label(
            f"TCPs of the two models, over the joints that both measured, with base and tool registered: "
            f"{fixed(models.tcp_rms_mm)} mm apart (RMS; max {fixed(models.tcp_max_mm)} mm); σ explains "
            f"{fixed(models.tcp_sigma_mm)} mm."
        )
    for why in models.left_out:
        ui.label(f"Not compared: {why}.").classes("note")
    of_both = numbers("a, ± 1 σ", "b, ± 1 σ", "b − a, ± 1 σ", "in σ")
    columns = [*words("Parameter", "Unit"), *of_both, *words("above 2 σ")]
    rows = [_cells(each) for each in models.parameters]
    marked = frozenset(number for number, each in enumerate(models.parameters) if each.significant)
    figures(columns, rows, label="Parameters", marked=marked)


def _cells(each: ParameterChange) -> list[str]:
    known = each.sigma is not None
    return [
        each.label,
        each.unit,
        _value(each.a, each.sigma_a),
        _value(each.b, each.sigma_b),
        _difference(each.difference, each.sigma),
        fixed(abs(each.difference) / each.sigma, 1) if each.sigma and each.difference is not None else "",
        _significance(each.significant) if known else "not determined by the rows of both",
    ]


async def _drift(a: str) -> None:
    serials = await indexed(lambda index: index.values("serial"))
    if not serials:
        return
    own = await indexed(lambda index: index.serial_of(a)) if a else ""
    note = "Parameters that the rows determine, in all runs of one robot that have a model. Base and tool are left out."
    with section("Drift of parameters", note=note):
        view = _DriftView()
        chosen = ui.select(serials, label="Robot", value=own or serials[0], on_change=view.changed)
        chosen.props("outlined dense").style("max-width: 18rem")
        view.area = ui.element("div").classes("section")
        await view.show(str(chosen.value))


@final
class _DriftView:
    """The drift of the chosen robot."""

    def __init__(self) -> None:
        self.area: ui.element | None = None

    async def changed(self, event: Any) -> None:
        await self.show(str(event.value))

    async def show(self, serial: str) -> None:
        """Show the robot `serial`."""
        rows = [summary_of(found) for found in await indexed(lambda index: index.with_model(serial))]
        found = await asyncio.to_thread(parameter_drift, console().runs, rows, serial)
        assert self.area is not None
        self.area.clear()
        with self.area:
            _series(found)


def _series(found: ParameterDrift) -> None:
    for run in found.left_out:
        ui.label(f"Left out: {run.run}: {run.why}.").classes("note")
    if len(found.runs) < 2:
        ui.label("A drift needs two runs with a model, a trend three on more than one day.").classes("note")
        return
    drifting = [each for each in found.parameters if each.drifts]
    ordered = sorted(found.parameters, key=lambda each: -_strength(each))
    if all(each.slope is None for each in found.parameters):
        ui.label("No trend yet: it needs three runs on more than one day.").classes("note")
    else:
        word = f"{len(drifting)} of {len(found.parameters)} parameters drift by more than 2 σ"
        state_word("warning" if drifting else "good", word)
    with ui.element("div").classes("small-charts"):
        for each in ordered[:_MOST_CHARTS]:
            with ui.element("div").classes("small-chart"):
                ui.label(f"{each.label}, {each.unit}").style(f"color: {INKS['working']}; font-weight: 600")
                if each.slope is not None:
                    ui.label(f"trend {_slope(each)} in 30 days{', above 2 σ' if each.drifts else ''}").classes("note")
                drift_chart(found.runs, each)
    columns = [*words("Parameter", "Unit"), *numbers("Trend in 30 days, ± 1 σ", *(each.run for each in found.runs))]
    rows = [[each.label, each.unit, _slope(each), *map(_value, each.values, each.sigmas)] for each in ordered]
    with ui.expansion(f"All {len(rows)} parameters as numbers").classes("wide"):
        figures(columns, rows, label="Drift of parameters")


def _strength(each: ParameterSeries) -> float:
    """How strong the drift is, in σ: of the trend, else of the last value from the first."""
    if each.slope is not None and each.slope_sigma:
        return abs(each.slope) / each.slope_sigma
    known = [
        (value, sigma) for value, sigma in zip(each.values, each.sigmas, strict=True) if value is not None and sigma
    ]
    return abs(known[-1][0] - known[0][0]) / (known[-1][1] or 1.0) if len(known) > 1 else 0.0


def _slope(each: ParameterSeries) -> str:
    return "not known" if each.slope is None or each.slope_sigma is None else with_sigma(each.slope, each.slope_sigma)


def _value(value: float | None, sigma: float | None) -> str:
    return "–" if value is None or sigma is None else with_sigma(value, sigma)


def _difference(value: float | None, sigma: float | None) -> str:
    if value is None:
        return "–"
    return with_sigma(value, sigma) if sigma else fixed(value)


def _significance(significant: bool | None) -> str:
    return "σ not known" if significant is None else "yes" if significant else "no"
