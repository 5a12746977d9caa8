"""Instrument and station over the run: nests, return pose, two faces, reflector constant, warm-up, weather, load."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cellctl.report import Contribution, ReportSection, Run, Sigma
from cellctl.report.figures import fixed, significant, with_sigma
from procedures.reports.tracker.targets import nests_picture
from procedures.steps.tracker.rows import (
    ConstantRow,
    MonumentsRow,
    NestRow,
    PoseRow,
    ReturnRow,
    SetUpRow,
    TwoFaceRow,
    WarmUpRow,
)


def build(run: Run) -> Mapping[str, Any]:
    """Picture and figures."""
    visits, returns = run.state.recorded(MonumentsRow), run.state.recorded(ReturnRow)
    moved = [row for row in visits if row.verdict != "still"]
    return {
        "sentence": _sentence(len(visits), moved),
        "picture": nests_picture(run.state.recorded(NestRow), visits, returns),
        "pairs_": [*_instrument(run), *_checks(run), *_conditions(run)],
    }


def environment(run: Run) -> Mapping[str, str]:
    """The air by the instrument's weather, and the temperatures of the cell at the start."""
    setup = run.state.last(SetUpRow)
    air, cell = (setup.weather, setup.temperatures) if setup else (None, None)
    of_air = {
        "air temperature": f"{air.temperature_c:.1f} °C",
        "air pressure": f"{air.pressure_hpa:.1f} hPa",
        "relative humidity": f"{air.humidity_percent:.0f} %",
    } if air else {}  # fmt: skip
    sensors = {f"{name} temperature": getattr(cell, name) for name in ("base", "fixture")} if cell else {}
    return {**of_air, **{name: f"{value:.1f} °C" for name, value in sensors.items() if value is not None}}


def contributions(run: Run) -> list[Contribution]:
    """The part of every point that is alike: no scatter shows it."""
    points = [row.point for row in run.state.recorded(PoseRow)]
    if not points:
        return []
    common = float(np.mean([np.trace(np.array(point.common)) for point in points])) ** 0.5
    source = f"accuracy profile {points[0].accuracy}: zero and scale of the range, refraction, centring"
    return [Contribution.of_errors("instrument: alike in all points", "B", source, common, 3)]


def _sentence(visits: int, moved: list[MonumentsRow]) -> str:
    if not moved:
        return f"The nests were visited {visits} times; the station was still."
    words = ", ".join(f"{row.verdict} by {significant(row.shift_mm)} mm at visit {row.visit + 1}" for row in moved)
    return f"The nests were visited {visits} times; the station {words}. Each motion begins a session."


def _instrument(run: Run) -> Iterator[tuple[str, str]]:
    pose = run.state.last(PoseRow)
    point = pose.point if pose else run.state.recorded(NestRow)[0].point
    note = " (noise of such an instrument only)" if point.noise_only else ""
    yield "accuracy profile", f"{point.accuracy}{note}"
    yield "samples of a point", str(point.samples)


def _checks(run: Run) -> Iterator[tuple[str, str]]:
    faces = run.state.recorded(TwoFaceRow)
    for when in dict.fromkeys(row.when for row in faces):
        worst = max((row.error.hz_mm**2 + row.error.v_mm**2) ** 0.5 for row in faces if row.when == when)
        yield f"two-face error at the {when}, mm", f"{fixed(worst)} (limit {faces[0].limit_mm:g})"
    if constant := run.state.last(ConstantRow):
        yield "error of the reflector constant, mm", with_sigma(constant.error_mm, constant.sigma_mm)
    if warm := run.state.last(WarmUpRow):
        yield "drift of the return pose when warm, mm", f"{fixed(warm.drift_bound_mm)} (limit {warm.limit_mm:g})"
        yield "warm-up, min", f"{warm.minutes:.0f}"


def _conditions(run: Run) -> Iterator[tuple[str, str]]:
    setup = run.state.last(SetUpRow)
    if setup is None:
        return
    if setup.weather:
        air = setup.weather
        yield "air", f"{air.temperature_c:.1f} °C, {air.pressure_hpa:.1f} hPa, {air.humidity_percent:.0f} %"
    yield (
        "load",
        f"{setup.load}, {setup.payload_kg:g} kg at {', '.join(f'{value:g}' for value in setup.payload_xyz)} mm",
    )
    yield "absolute accuracy of the controller", "off"


SECTION = ReportSection(
    id="tracker-station",
    title="Instrument and station",
    order=70,
    needs=(NestRow,),
    build=build,
    environment=environment,
    contributions=contributions,
    sigmas=(
        Sigma(
            "error of the reflector constant ± σ",
            "the difference of the constant in use from that of the certified distances",
            "from the points of the nests and the certificate",
            "1 σ",
        ),
    ),
    template="""\
{% from "pairs.html" import pairs %}
<p>{{ sentence }}</p>
<figure>{{ picture | safe }}</figure>
{{ pairs(pairs_) }}
""",
)
