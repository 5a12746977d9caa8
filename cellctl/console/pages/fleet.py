"""`/fleet`: which robots need a calibration, and why; the charts of a robot."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any
from urllib.parse import quote, urlencode

from nicegui import ui

from cellctl.console.appearance import (
    INKS,
    Cell,
    State,
    figures,
    numbers,
    section,
    shown_time,
    state_word,
    words,
)
from cellctl.console.charts import change_chart
from cellctl.console.commands import indexed
from cellctl.console.frame import frame
from cellctl.console.shared import console
from cellctl.operations.fleet import Fleet, FleetReading, FleetRobot, RobotCharts
from cellctl.report.figures import fixed, with_sigma
from cellctl.run_index import RunIndex

_MOST = 50
"""Number of robots in the list, and of charts."""

_MOST_CHARTS = 12

_LOOKS: dict[str, State] = {
    "calibrate": "bad",
    "in limits": "good",
    "not judged": "unknown",
    "not calibrated": "off",
}
_ABOUT = (
    "Each parameter that the rows determine has a chart: a moving average (EWMA) of its runs, less the calibration. "
    "A robot that has not changed has at most one false alarm in five years on average, all its charts together."
)


@ui.page("/fleet", response_timeout=30.0)
async def fleet(type: str = "", site: str = "", robot: str = "") -> None:  # noqa: A002
    """The robots of the index, the most urgent first."""
    runs = console().runs

    def read(index: RunIndex) -> tuple[Fleet, Fleet, RobotCharts | None]:
        reading = FleetReading(index, runs)
        whole = reading.fleet()
        chosen = reading.fleet(type, site) if type or site else whole
        charted = [each.serial for each in chosen.robots if each.charts]
        serial = robot if robot in charted else next(iter(charted), "")
        return whole, chosen, reading.charts(serial) if serial else None

    whole, chosen, charts = await indexed(read)
    with frame("Fleet", "/fleet"):
        if not whole.robots:
            ui.label("No run in this folder has a robot with a serial number.")
            return
        _choice(whole, type, site)
        _robots(chosen, type, site)
        if charts:
            _charts(chosen, charts, type, site)
        _groups(chosen)
        _small_sigmas(chosen)


def _address(**asked: str) -> str:
    return f"/fleet?{urlencode({name: value for name, value in asked.items() if value})}"


def _choice(whole: Fleet, robot_type: str, site: str) -> None:
    def options(values: Collection[str]) -> dict[str, str]:
        return {"": "any", **{value: value for value in sorted({*values} - {""})}}

    with ui.element("div").classes("row search").props("role=search"):
        types = options({robot_type, *(robot.type for robot in whole.robots)})
        sites = options({site, *(robot.site for robot in whole.robots)})
        for label, known, value, other in (("Type", types, robot_type, site), ("Site", sites, site, robot_type)):
            names = ("type", "site") if label == "Type" else ("site", "type")

            def go(event: Any, names: tuple[str, str] = names, other: str = other) -> None:
                ui.navigate.to(_address(**{names[0]: event.value or "", names[1]: other}))

            ui.select(known, label=label, value=value, on_change=go).props("outlined dense").style("min-width: 14rem")


def _robots(found: Fleet, robot_type: str, site: str) -> None:
    count = len(found.to_calibrate)
    with section("Robots", note=_ABOUT):
        said = f"{count} of {len(found.robots)} robots need{'s' * (count == 1)} a calibration"
        state_word("bad" if count else "good", said, large=True)
        columns = [*words("Robot", "State", "Why", "Type", "Site", "Calibrated"), *numbers("age, days", "runs a year")]
        rows = [_row(robot, robot_type, site) for robot in found.robots[:_MOST]]
        figures(columns, rows, label="Robots").style("max-height: 26rem").classes("wrapping")
        if len(found.robots) > _MOST:
            ui.label(f"{len(found.robots) - _MOST} more robots: choose a type or a site.").classes("note")
        if found.left_out:
            text = "runs are not compared: of another nominal robot, or with the model of an earlier run."
            ui.label(f"{found.left_out} {text}").classes("note")


def _row(robot: FleetRobot, robot_type: str, site: str) -> list[Cell]:
    address = _address(type=robot_type, site=site, robot=robot.serial) + "#charts"
    by = f"/run/{quote(robot.calibration)}/result"
    return [
        (lambda: ui.link(robot.serial, address)) if robot.charts else robot.serial,
        lambda: state_word(_LOOKS[robot.state], robot.state),
        robot.words or "–",
        robot.type + " (SIMULATED)" * robot.simulated,
        robot.site or "–",
        (lambda: ui.link(shown_time(robot.calibrated, "%Y-%m-%d"), by)) if robot.calibration else "–",
        fixed(robot.age_days, 0),
        fixed(robot.runs_a_year, 0) if robot.charts else "–",
    ]


def _charts(found: Fleet, charts: RobotCharts, robot_type: str, site: str) -> None:
    robot = next(each for each in found.robots if each.serial == charts.serial)
    note = (
        f"{len(charts.runs)} runs from {charts.runs[0]} on, {robot.charts} parameters. Points: moving average less "
        "reference; dashed: its limits; bars: single runs with 2 σ. Diamonds are outside the limits."
    )
    with section(f"Charts of {charts.serial}", note=note).props("id=charts"):
        serials = [each.serial for each in found.robots if each.charts]
        chosen = ui.select(
            serials,
            label="Robot",
            value=charts.serial,
            with_input=True,
            on_change=lambda event: ui.navigate.to(_address(type=robot_type, site=site, robot=event.value or "")),
        )
        chosen.props("outlined dense").style("max-width: 18rem")
        if len(charts.runs) < 2:
            ui.label("A chart needs a run after the calibration.").classes("note")
            return
        with ui.element("div").classes("small-charts"):
            for each in charts.parameters[:_MOST_CHARTS]:
                with ui.element("div").classes("small-chart"):
                    ui.label(f"{each.label}, {each.unit}").style(f"color: {INKS['working']}; font-weight: 600")
                    found_step = (
                        f"a step of {each.found:.2g} {each.unit} is found within ten runs" if each.found else ""
                    )
                    ui.label(found_step).classes("note")
                    change_chart(charts.began, each)
        columns = [
            *words("Parameter", "Unit"),
            *numbers("change, ± 1 σ", "limit", "found within ten runs", "σ widened"),
        ]
        with ui.expansion(f"All {len(charts.parameters)} parameters as numbers").classes("wide"):
            figures(columns, _numbers(robot, charts), label="Charts as numbers")


def _numbers(robot: FleetRobot, charts: RobotCharts) -> Iterator[list[Cell]]:
    for each in charts.parameters:
        known = [pair for pair in zip(each.means, each.limits, strict=True) if None not in pair]
        mean, limit = known[-1] if known else (None, None)
        sigma = limit / robot.limit if limit and robot.limit else 0.0
        change = "–" if mean is None else with_sigma(mean, sigma)
        widened = f"× {each.scale:.2f}" if each.scale > 1.0 else "–"
        yield [
            each.label,
            each.unit,
            change,
            *(f"{size:.2g}" if size else "–" for size in (limit, each.found)),
            widened,
        ]


def _groups(found: Fleet) -> None:
    note = "A parameter that moved in most robots together says more of instrument or temperature than of the robots."
    with section("Types and sites", note=note):
        rows = [
            [
                f"{group.kind} {group.name}",
                str(group.robots),
                str(group.to_calibrate),
                "; ".join(each.words for each in group.moved) or "–",
            ]
            for group in found.groups
        ]
        marked = frozenset(number for number, group in enumerate(found.groups) if group.moved)
        columns = [*words("Group"), *numbers("robots", "to calibrate"), *words("moved together")]
        figures(columns, rows, label="Types and sites", marked=marked)


def _small_sigmas(found: Fleet) -> None:
    if not found.small_sigmas:
        return
    note = "The scatter between runs exceeds the stated σ. The charts use the scatter: look for its cause."
    with section("Stated σ too small", note=note):
        columns = [*words("Parameter", "Of"), *numbers("scatter / σ", "differences")]
        rows = [
            [each.name, each.serial or f"all {each.type}", f"{each.scale:.2f}", str(each.differences)]
            for each in found.small_sigmas[:_MOST]
        ]
        figures(columns, rows, label="Stated σ too small")
