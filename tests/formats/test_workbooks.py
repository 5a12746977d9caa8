"""Workbooks: the numbers of the only sheet with rows, to the last digit; others are refused with what to do."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import pytest
from openpyxl import Workbook

from cellctl.files import InputError
from cellctl.formats.dataset import DataSet
from cellctl.formats.workbook import table_of_workbook
from cellctl.pendant_import import Choices, columns_of, imported


def workbook(*sheets: list[list[object]]) -> bytes:
    book = Workbook()
    book.remove(book.active)
    for rows in sheets:
        sheet = book.create_sheet()
        for row in rows:
            sheet.append(row)
    content = BytesIO()
    book.save(content)
    return content.getvalue()


ROWS: list[list[object]] = [
    ["Point", "shoulder", "upper arm, deg", "elbow", "X [mm]", "Y [mm]", "Z [mm]"],
    *([f"P{n}", 10.5 + n, -20.25, 100.0, 1000.125 + n, -0.1, 3] for n in range(8)),
]


def test_a_workbook_is_read_as_the_table_on_its_sheet(tmp_path: Path) -> None:
    path = tmp_path / "grid.xlsx"
    path.write_bytes(workbook(ROWS, []))
    named = {"A1": "shoulder", "A2": "upper arm, deg", "A3": "elbow"}
    found = imported(path, None, Choices(angles="deg", columns=named))
    assert [len(found.records), found.records[0]["name"], found.records[0]["X"]] == [8, "P0", 1000.125]
    assert [found.records[7][f"A{number}"] for number in (1, 2, 3)] == [17.5, -20.25, 100.0]
    assert [column.means for column in columns_of(path)] == ["name", "", "", "", "X", "Y", "Z"]


def test_a_workbook_can_be_a_data_set(tmp_path: Path) -> None:
    path = tmp_path / "set.xlsx"
    path.write_bytes(workbook([["A1", "A2", "X", "Y", "Z"], [1.5, 2, 3.25, 4, 5]]))
    data = DataSet.load(path)
    assert (data.texts("A1"), data.texts("X")) == (["1.5"], ["3.25"])


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (workbook(ROWS, ROWS), "has rows on 2 sheets"),
        (workbook([]), "has no sheet with rows"),
        (b"PK\x03\x04....", "is a spreadsheet that cannot be read"),
    ],
)
def test_a_workbook_without_one_sheet_of_rows_is_refused(content: bytes, what: str) -> None:
    with pytest.raises(InputError) as refused:
        table_of_workbook(content, "a.xlsx")
    assert refused.value.problems[0].what.startswith(what)
