"""`Model.compensate_program`: the files and figures of `cellctl compensate program.src`."""

import json

import pytest

import cellctl
from tests.helpers.arms import cellctl as command
from tests.helpers.arms import kr5_model, printed_errors
from tests.helpers.krl import position, readings_at, usual_seam


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """`seam.src`, `seam.dat`, `$config.dat` and `model.json`."""
    usual_seam().write(tmp_path)
    kr5_model().save(tmp_path / "model.json")
    (tmp_path / "command").mkdir()
    (tmp_path / "python").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def model(folder):
    return cellctl.load("model.json")


def test_files_and_report_are_those_of_the_command(model, folder):
    words = ("--config", "$config.dat", "-o", "command", "--json", "all.json")
    assert command("compensate", "model.json", "seam.src", *words) == 0
    told = json.loads((folder / "all.json").read_text())
    program = model.compensate_program("seam.src", config="$config.dat")
    assert json.loads(json.dumps(program.report)) == {**told, "files": []}
    assert [path.name for path in program.save("python")] == ["seam.src", "seam.dat"]
    for name in ("seam.src", "seam.dat"):
        assert (folder / "python" / name).read_bytes() == (folder / "command" / name).read_bytes()
    assert program.texts["src"] == (folder / "python" / "seam.src").read_bytes()


def test_a_program_is_not_written_over(model, folder):
    before = (folder / "seam.src").read_bytes()
    program = model.compensate_program("seam.src", config="$config.dat")
    with pytest.raises(cellctl.InputError, match="would be written over"):
        program.save(folder)
    assert (folder / "seam.src").read_bytes() == before


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "write-back-zeros"}, ["--method", "write-back-zeros"]),
        ({"tool": [1.0, 2.0]}, ["--tool", "1.0,2.0"]),
        ({"cell": "heavy_robot_cell"}, ["--cell", "heavy_robot_cell"]),
        ({}, []),
    ],
    ids=str,
)
def test_errors_are_those_of_the_command(model, capsys, options, words):
    assert command("compensate", "model.json", "seam.src", "-o", "command", *words) == 2
    printed = printed_errors(capsys)
    with pytest.raises(cellctl.InputError) as refused:
        model.compensate_program("seam.src", **options)
    assert str(refused.value).strip() == printed


def test_a_program_is_shown_with_its_places_left(model, folder):
    seam = usual_seam()
    seam.point("P10", position(readings_at((0, 50, 0))))
    seam.dat[-2] = seam.dat[-2].replace("DECL E6POS", "DECL GLOBAL E6POS")
    seam.form("PTP", "P10")
    seam.write(folder)
    program = model.compensate_program("seam.src", config="$config.dat")
    shown = program._repr_html_()
    assert "5 points compensated, 1 place left unchanged" in shown
    (left,) = program.report["left"]
    assert f"seam.src:{left['line']}: " in shown
    assert "GLOBAL" in shown
