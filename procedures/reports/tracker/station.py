"""Instrument and station over the run: nests, checks, warm-up, weather, load; the frames {B} and {T} by turned axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cellctl.kinematics import abc_from_rotation
from cellctl.report import Contribution, ReportSection, Run, Sigma, fixed, significant, with_sigma
from procedures.reports.tracker.targets import nests_picture
from procedures.steps.tracker.rows import (
    ConstantRow,
    FrameFigures,
    FramesRow,
    MonumentsRow,
    NestRow,
    PoseRow,
    ReturnRow,
    SetUpRow,
    TwoFaceRow,
    WarmUpRow,
)


def _station(run: Run) -> Mapping[str, Any]:
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


STATION_SECTION = ReportSection(
    id="tracker-station",
    title="Instrument and station",
    order=70,
    needs=(NestRow,),
    build=_station,
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


def _frames(run: Run) -> Mapping[str, Any] | None:
    """The frames by place and angles, the circles, the reflector, gravity."""
    row = run.state.last(FramesRow)
    if row is None:
        return None
    off = float(np.linalg.norm(np.subtract(row.reflector, row.rough)))
    circles = zip(("A1", "A2", "A5", "A6"), row.radius, row.radius_sigma, row.residual, strict=True)
    return {
        "frames": [
            ("{B}, instrument's frame", _cells(row.base)),
            ("{T}, instrument's frame", _cells(row.tool)),
            ("instrument, base frame", _cells(row.station)),
        ],
        "circles": [(axis, with_sigma(radius, sigma), significant(rest)) for axis, radius, sigma, rest in circles],
        "outliers": row.outliers,
        "reflector": list(map(with_sigma, row.reflector, row.reflector_sigma)),
        "off": significant(off),
        "gravity": _gravity(row),
    }


def _cells(frame: FrameFigures) -> list[str]:
    """X, Y, Z, mm; the turn's A, B, C, deg, with the largest σ of the turn."""
    matrix = np.array(frame.matrix)
    places = [with_sigma(value, sigma) for value, sigma in zip(matrix[:3, 3], frame.sigma[:3], strict=True)]
    angles = [with_sigma(value, max(frame.sigma[3:])) for value in abc_from_rotation(matrix[:3, :3])]
    return [text.replace(" ± ", "\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}") for text in (*places, *angles)]


def _gravity(row: FramesRow) -> str:
    if row.gravity_deg is None or row.gravity_sigma_deg is None:
        return "The instrument is not levelled: it shows nothing of gravity."
    angle = with_sigma(row.gravity_deg, row.gravity_sigma_deg)
    return f"The levelled instrument's vertical and that of the robot file include {angle}°."


FRAMES_SECTION = ReportSection(
    id="tracker-frames",
    title="Frames by turned axes",
    order=30,
    needs=(FramesRow,),
    build=_frames,
    sigmas=(
        Sigma(
            "frames ± σ",
            "one coordinate of a frame; of its angles, the largest of the three turns",
            "circle fits, with the common part of the instrument's error; errors of the robot's links are not in it",
            "1 σ",
        ),
    ),
    template="""\
<p>{B}: z on A1, x along the common perpendicular of A1 and A2. {T}: x on A6, z perpendicular to A5 and A6, origin at
the reflector.</p>
<table style="font-size: .74rem">
<thead><tr><th>frame</th><th>X, mm</th><th>Y, mm</th><th>Z, mm</th><th>A, °</th><th>B, °</th><th>C, °</th></tr></thead>
<tbody>
{% for name, cells in frames %}
<tr><th>{{ name }}</th>{% for cell in cells %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
</tbody>
</table>
<table>
<thead><tr><th>circle of</th><th>radius, mm</th><th>residual, mm RMS</th></tr></thead>
<tbody>
{% for axis, radius, rest in circles %}
<tr><th>{{ axis }}</th><td>{{ radius }}</td><td>{{ rest }}</td></tr>
{% endfor %}
</tbody>
</table>
<p>Reflector in the flange frame: {{ reflector | join(", ") }} mm, {{ off }} mm from the cell file's place.
{% if outliers %}{{ outliers }} points of the circles are outliers and were left out.{% endif %} {{ gravity }}</p>
""",
)
