"""`cellctl firmware`: what is needed to build and load the contact probe, from an installed package too."""

import json
import re
import shutil
import subprocess
import zipfile

import pytest
from typer.testing import CliRunner

from cellctl.cli.verbs import app
from cellctl.files import InputError
from tests.helpers.runs import ROOT

SHIPPED = ROOT / "drivers" / "contact_probe" / "firmware"


def cellctl(*words):
    """What a call prints. Raises its error."""
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False).stdout


def needed():
    """What one needs to build the firmware and to load it without building."""
    lists = re.findall(r"^(?:SOURCES|HEADERS) = (.*)$", (SHIPPED / "Makefile").read_text(), re.MULTILINE)
    return {"README.md", "Makefile", "schematic.svg", "contact_probe.hex", *" ".join(lists).split()}


def test_every_file_of_the_firmware_is_written_as_it_is(tmp_path):
    out = tmp_path / "new" / "probe"
    assert "contact_probe.hex" in cellctl("firmware", "-o", out)
    assert {file.name for file in out.iterdir()} == needed()
    for file in out.iterdir():
        assert file.read_bytes() == (SHIPPED / file.name).read_bytes()


def test_the_json_lists_the_files(tmp_path):
    told = json.loads(cellctl("firmware", "-o", tmp_path, "--json", "-"))
    assert told["folder"] == str(tmp_path)
    assert set(told["files"]) == {file.name for file in tmp_path.iterdir()}


@pytest.mark.parametrize("target", ["folder", "file"])
def test_what_is_there_is_not_written_over(tmp_path, target):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "main.c").write_text("mine")
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="give -o a new or empty folder"):
        cellctl("firmware", "-o", tmp_path / target)
    assert (tmp_path / "folder" / "main.c").read_text() == (tmp_path / "file").read_text() == "mine"


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"(?s)could not be written.*give -o another folder"):
        cellctl("firmware", "-o", tmp_path / "file" / "probe")


@pytest.mark.parametrize(("scheme", "why"), [("modbus+tcp", "no firmware"), ("contact+seral", "did you mean")])
def test_a_device_without_firmware_is_refused(tmp_path, scheme, why):
    result = CliRunner().invoke(app, ["firmware", "-o", str(tmp_path / "probe"), "--scheme", scheme])
    assert result.exit_code == 2
    assert why in result.output
    assert not (tmp_path / "probe").exists()


@pytest.mark.long
@pytest.mark.skipif(not shutil.which("uv"), reason="uv builds the wheel")
def test_a_built_wheel_has_every_file_of_the_firmware(tmp_path):
    subprocess.run(["uv", "build", "--quiet", "--wheel", "-o", tmp_path], cwd=ROOT, check=True)
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as wheel:
        inside = {name.removeprefix("drivers/contact_probe/firmware/") for name in wheel.namelist()}
    assert needed() <= inside
    assert not [name for name in inside if name.endswith(".elf")]
