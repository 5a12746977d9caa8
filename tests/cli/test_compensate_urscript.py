"""`cellctl compensate MODEL part.script`: the files that are written, the exit code, and options of KRL."""

from __future__ import annotations

import json

import numpy as np
import pytest

import cellctl as facade
from tests.helpers.arms import cellctl
from tests.helpers.ur import HOME, MODEL, SET_TCP, p, shifted

PROGRAM = f"def part():\n{SET_TCP}  movej({HOME}, a=1.4)\n  movel({p(shifted(40.0))}, v=0.1)\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    MODEL.save(tmp_path / "model.json")
    (tmp_path / "part.script").write_text(f"{PROGRAM}end\n")
    return tmp_path


def test_the_program_is_written_with_its_figures(folder, capsys):
    assert cellctl("compensate", "model.json", "part.script", "-o", "out", "--json", "all.json") == 0
    figures = json.loads((folder / "all.json").read_text())
    assert figures["files"] == ["out/part.script"]
    assert [each["line"] for each in figures["points"]] == [3, 4]
    assert [list(each["numbers"]) for each in figures["points"]] == [
        [f"q{axis}" for axis in range(1, 7)],
        ["X", "Y", "Z", "RX", "RY", "RZ"],
    ]
    assert [each["kind"] for each in figures["paths"]] == ["movel"]
    assert figures["after_mm"]["max"] < 1e-4 < 0.3 < figures["before_mm"]["mean"]
    assert "2 points compensated for a Universal Robots UR10e" in capsys.readouterr().out
    python = facade.load("model.json").compensate_program("part.script")
    assert python.texts["script"] == (folder / "out" / "part.script").read_bytes()
    assert np.isfinite([each["correction_mm"] for each in python.report["points"]]).all()


def test_places_that_stay_show_in_the_exit_code(folder, capsys):
    (folder / "part.script").write_text(f"{PROGRAM}  movel(get_actual_tcp_pose())\nend\n")
    assert cellctl("compensate", "model.json", "part.script", "-o", "new.script") == 1
    said = capsys.readouterr()
    assert "part.script:5: movel: the point is computed" in said.out
    assert "1 place is not compensated" in said.err
    assert "get_actual_tcp_pose" in (folder / "new.script").read_text()


REFUSED = {
    "a folder's name with another suffix": (["-o", "new.txt"], "neither a folder nor a .script file"),
    "the program itself": (["-o", "part.script"], "part.script"),
    "data of KRL": (["--config", "config.dat"], "is for KRL"),
    "a base": (["--base", "0,0,0,0,0,0"], "is for KRL"),
}


@pytest.mark.parametrize(("words", "said"), REFUSED.values(), ids=list(REFUSED))
def test_what_is_not_for_a_script_is_refused(folder, capsys, words, said):
    before = (folder / "part.script").read_bytes()
    assert cellctl("compensate", "model.json", "part.script", *words) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert (folder / "part.script").read_bytes() == before
