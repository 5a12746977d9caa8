"""A record of a commissioning gives the simulators the delays and habits of the real cell."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sims.cell import CellError, read_cell
from tests.helpers.runs import cell_with


def record(folder: Path, *cells: dict[str, Any], text_format: str = "cellctl commissioning 1") -> None:
    (folder / "commissioning.json").write_text(json.dumps({"format": text_format, "cells": list(cells)}))


def of(cell: str, *, simulated: bool = False, **figures: Any) -> dict[str, Any]:
    """A cell's record with these figures, `robot__telegrams__port="new"`."""
    steps = []
    for name, value in figures.items():
        device, step, figure = name.split("__")
        steps.append({"id": f"{device}.{step}", "figures": [{"name": figure, "value": value}]})
    return {"cell": cell, "simulated": simulated, "steps": steps}


def settings(folder: Path, lines: str = "") -> dict[str, dict[str, Any]]:
    cell = cell_with(
        folder,
        f"  commissioning: commissioning.json\n{lines}",
        {"devices:\n": "devices:\n  plc: modbus+tcp://192.168.10.5:502?unit=1\n"},
    )
    return read_cell(cell).simulate.settings


def test_figures_become_settings_and_what_the_file_states_wins(tmp_path):
    measured = of(
        "sphere cell",
        robot__telegrams__jitter_ms=0.12,
        robot__telegrams__port="new",
        robot__telegrams__cycle_ms=12.0,
        robot__stop__lag_ms=31.5,
        probe__trip__bounces=5,
        probe__connection__latency_spread_ms=7.8,
        plc__connection__latency_least_ms=2.5,
        plc__connection__latency_most_ms=9.0,
    )
    record(tmp_path, measured)
    found = settings(tmp_path, "  rsi: {lag_ms: 20}\n")
    rsi = found["rsi"]
    assert (rsi["jitter_ms"], rsi["port"], rsi["cycle_ms"]) == (0.12, "new", 12)
    assert rsi["lag_ms"] == 20
    assert rsi["mark"] == "session", "not measured: the default"
    assert found["probe"] == {"usb_delay_ms": 7.8, "bounce": 4}, "an even number of further edges"
    assert (found["plc"]["delay_least_ms"], found["plc"]["delay_most_ms"]) == (2.5, 9.0)


def test_the_record_of_the_real_cell_counts_where_there_are_two(tmp_path):
    simulated = of("sphere cell", simulated=True, robot__telegrams__port="kept")
    record(tmp_path, simulated, of("sphere cell", robot__telegrams__port="new"))
    assert settings(tmp_path)["rsi"]["port"] == "new"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "No such file"),
        ({"cells": [of("other cell", robot__telegrams__port="new")]}, "no record of the cell 'sphere cell'"),
        ({"cells": [], "text_format": "of another program"}, "'of another program'"),
        ({"cells": [of("sphere cell", robot__telegrams__cycle_ms=5.0)]}, "rsi.cycle_ms: 4 or 12 is expected, not 5"),
        ({"cells": [{"cell": "sphere cell"}]}, "can be read"),
    ],
)
def test_a_record_that_cannot_be_used_is_an_error_of_the_cell_file(tmp_path, content, words):
    if content is not None:
        record(tmp_path, *content["cells"], text_format=content.get("text_format", "cellctl commissioning 1"))
    with pytest.raises(CellError) as caught:
        settings(tmp_path)
    assert words in str(caught.value)
    assert "simulate." in str(caught.value)
