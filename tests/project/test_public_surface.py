"""What authors of extensions may import is recorded with its signatures, and listed on a page."""

from tests.project.public_surface import PAGE, RECORD, page, recorded, without_docstring

REMEDY = "if you mean it: python tests/project/public_surface.py, and say in docs/extend what authors have to change"


def test_the_public_surface_is_as_recorded():
    assert recorded().splitlines() == RECORD.read_text().splitlines(), REMEDY


def test_the_page_lists_it():
    assert page() == PAGE.read_text(), REMEDY


def test_each_public_name_says_what_it_is():
    assert without_docstring() == []
