"""Messages of an import name the fields of the page, not options of the command line."""

from __future__ import annotations

import pytest

from cellctl.console.pages.analyse import names_fields
from cellctl.files import Problem


@pytest.mark.parametrize(
    ("cure", "shown"),
    [
        ("--angles deg or --angles rad", "‘Unit of the joints’ deg or ‘Unit of the joints’ rad"),
        ("name the columns: --columns X=…,Y=…", "name the columns: ‘Columns of the file’ X=…,Y=…"),
        ("give it: --repeatability MM (1 σ, 3-D)", "give it: ‘Repeatability of a URDF's robot, mm’ (1 σ, 3-D)"),
        ("correct the names", "correct the names"),
    ],
)
def test_a_cure_names_the_field_to_fill_in(cure: str, shown: str) -> None:
    assert names_fields(Problem("a.csv", 1, 0, "is ambiguous", cure)).cure == shown
