"""The cell file says how far a table may correct a joint."""

from pathlib import Path

import pytest

from cellctl.devices.cell import Cell, table_correction_deg
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, load_yaml

CELL = Path(__file__).parents[3] / "procedures" / "cells" / "sphere_cell.yaml"


def cell_with(folder, old, new):
    text = CELL.read_text()
    assert old in text
    path = folder / "cell.yaml"
    (folder / "rsi_ethernet.xml").write_text((CELL.parent / "rsi_ethernet.xml").read_text())
    robots = CELL.parents[1] / "robots"
    path.write_text(text.replace("../robots", str(robots)).replace(old, new))
    return path


def test_a_cell_that_says_nothing_allows_two_degrees():
    assert Cell.load(CELL, DriverRegistry()).table_correction_deg == 2.0


def test_the_cell_files_limit_counts_for_command_line_and_steps(tmp_path):
    path = cell_with(tmp_path, "limits:\n", "limits:\n  table: {correction_deg: 0.8}\n")
    assert Cell.load(path, DriverRegistry()).table_correction_deg == 0.8
    assert table_correction_deg(load_yaml(path)) == 0.8


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("{correction_deg: 0}", "cannot be limited to 0°"),
        ("{correction_deg: .nan}", "cannot be limited to nan°"),
        ("{correction_deg: 90}", "cannot be limited to 90°"),
        ("{correction_mm: 2}", "unknown table limit 'correction_mm'"),
    ],
)
def test_a_limit_that_cannot_be_meant_is_refused_at_its_line(tmp_path, line, words):
    path = cell_with(tmp_path, "limits:\n", f"limits:\n  table: {line}\n")
    with pytest.raises(InputError) as refused:
        Cell.load(path, DriverRegistry())
    line_number = path.read_text().splitlines().index(f"  table: {line}") + 1
    assert words in str(refused.value)
    assert f"cell.yaml:{line_number}:" in str(refused.value)


def test_a_device_cannot_take_the_tables_place(tmp_path):
    path = cell_with(tmp_path, "probe: contact", "table: contact")
    with pytest.raises(InputError, match="cannot be called 'table'"):
        Cell.load(path, DriverRegistry())
