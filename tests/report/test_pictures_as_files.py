"""The pictures of a report as files: every one that the page has, as it draws it, in forms that other programs read."""

import io
import re
import xml.etree.ElementTree as ElementTree
import zipfile

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.operations.export import Form, export_run
from cellctl.report import report_pictures, report_text

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def run(make_run_once, campaign):
    return make_run_once(campaign)


@pytest.fixture(scope="module")
def pictures(run):
    return report_pictures(run)


@pytest.mark.long
def test_every_picture_of_the_page_is_there_in_its_order_with_what_it_shows(run, pictures):
    on_page = re.findall(r'<svg role="img" aria-label="([^"]*)"', report_text(run))
    assert len(on_page) > 5
    assert [picture.alt for picture in pictures] == on_page
    assert len({picture.name for picture in pictures}) == len(pictures)


@pytest.mark.long
def test_a_file_draws_what_the_page_draws(run, pictures):
    text = report_text(run)
    for picture in pictures:
        root = ElementTree.fromstring(picture.svg)
        assert root.tag == f"{SVG}svg"
        on_page = text.partition(f'aria-label="{picture.alt}"')[2].partition("</svg>")[0]
        paths = [path.get("d", "").split() for path in root.iter(f"{SVG}path") if path.get("d")]
        assert paths == [path.split() for path in re.findall(r' d="([^"]+)"', on_page)], picture.name


def test_the_png_is_as_wide_as_the_page_at_200_dots_per_inch(pictures):
    for picture in pictures:
        assert picture.png.startswith(b"\x89PNG")
        assert int.from_bytes(picture.png[16:20], "big") == 1440


@pytest.mark.long
def test_the_same_run_gives_the_same_files_and_the_page_stays_as_it_is(run):
    before = report_text(run)
    assert export_run(run, Form.FIGURES).content == export_run(run, Form.FIGURES).content
    assert report_text(run) == before


@pytest.mark.long
def test_the_command_writes_them_into_one_zip_with_a_list(run, pictures, tmp_path):
    out = tmp_path / "figures.zip"
    words = ["export", str(run), "--as", "figures", "-o", str(out)]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == 0
    with zipfile.ZipFile(io.BytesIO(out.read_bytes())) as archive:
        names, readme = set(archive.namelist()), archive.read("README.txt").decode()
    assert names == {"README.txt", *(f"{each.name}.{end}" for each in pictures for end in ("svg", "png"))}
    assert all(each.alt in readme for each in pictures)
