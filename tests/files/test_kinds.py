"""A file of another kind is refused in one sentence, which says what it is and what is needed."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from cellctl.cli.exit_codes import exit_code_of
from cellctl.cli.verbs import app
from cellctl.files.kinds import CELL, DATA_SET, PROCEDURE, ROBOT, kind_of, kind_of_file
from tests.helpers.arms import kr5_model

SHIPPED = Path(__file__).parents[2] / "procedures"
DATA = "A1,A2,A3,A4,A5,A6,X,Y,Z\n0,-90,90,0,45,0,1,2,3\n"


@pytest.mark.parametrize(("folder", "kind"), [("robots", ROBOT), ("cells", CELL), (".", PROCEDURE)])
def test_every_shipped_file_is_recognised(folder: str, kind: str) -> None:
    files = sorted((SHIPPED / folder).glob("*.yaml"))
    assert files
    assert {kind_of_file(file) for file in files} == {kind}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "hello",
        "1,2,3\n4,5,6\n",
        "name: x\n",
        "{",
        '{"a": 1}',
        "[1, 2]",
        "Point;Value\nP1;3\n",
        "X: 1.0 mm, Y: 2.0 mm",
    ],
)
def test_what_is_not_certain_is_not_named(text: str) -> None:
    assert kind_of(text) == ""


@pytest.mark.parametrize("text", [DATA, "A1;A2;A3;X;Y;Z\n", '"q1","q2","sphere"\n', "\ufeffX\tY\tZ\r\n"])
def test_a_data_set_is_known_by_its_columns(text: str) -> None:
    assert kind_of(text) == DATA_SET


@pytest.mark.parametrize(
    ("words", "what", "needed"),
    [
        ("fit {cells}/sphere_cell.yaml data.csv", "a cell file", "a robot file"),
        ("fit data.csv data.csv", "a data set (CSV)", "a robot file"),
        ("fit model.json data.csv", "a model file", "a robot file"),
        ("fit {robots}/kr5_r1400.yaml {cells}/sphere_cell.yaml", "a cell file", "a data set (CSV)"),
        ("fit {robots}/kr5_r1400.yaml data.csv --artefact {robots}/gp7.yaml", "a robot file", "an artefact file"),
        ("fit {robots}/kr5_r1400.yaml data.csv --prior {robots}/gp7.yaml", "a robot file", "a model file"),
        ("check {robots}/kr5_r1400.yaml", "a robot file", "a procedure"),
        ("check {procedures}/sphere_selfcal.yaml --cell {robots}/kr5_r1400.yaml", "a robot file", "a cell file"),
        ("doctor {procedures}/sphere_selfcal.yaml", "a procedure", "a cell file"),
        ("predict {robots}/kr5_r1400.yaml data.csv", "a robot file", "a model file"),
        ("predict run data.csv", "a folder of a run", "a model file"),
        ("compensate model.json {robots}/kr5_r1400.yaml", "a robot file", "a data set (CSV)"),
        ("table push model.json --cell {cells}/sphere_cell.yaml", "a model file", "a table file"),
        ("import {robots}/kr5_r1400.yaml", "a robot file", "a file that a pendant saved"),
        ("show {robots}/kr5_r1400.yaml", "a robot file", "a journal of a run"),
    ],
)
def test_a_wrong_kind_of_file_is_one_sentence(
    words: str,
    what: str,
    needed: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("data.csv").write_text(DATA)
    Path("run").mkdir()
    sqlite3.connect("run/journal.sqlite").close()
    kr5_model().save(Path("model.json"))
    places = {"robots": SHIPPED / "robots", "cells": SHIPPED / "cells", "procedures": SHIPPED}
    given = words.format(**places).split()
    assert exit_code_of(lambda: app(given, standalone_mode=False)) == 2
    said = capsys.readouterr().err
    assert f"this is {what}, and {needed} is needed here" in said
    assert len(said.splitlines()) <= 3
