"""Lengths from a draw-wire that counts from wherever it was switched on, as a person hands them to `cellctl fit`."""

import json
from dataclasses import replace

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile
from tests.helpers.arms import ELBOW_ROBOT, ElbowArm, csv_text, drawn

NOISE_MM = 0.01
ARM = replace(ElbowArm(), at=(0.0, 0.0, 0.0))
ANCHORS = {"left": np.array([900.0, 600.0, 100.0]), "right": np.array([800.0, -700.0, 900.0])}
ZEROS = {"W1": 412.7, "W2": -388.1}
NAMES = ("A1", "A2", "A3", "anchor", "distance", "zero")


@pytest.fixture
def fitted(tmp_path, monkeypatch):
    """Fits a data set's text; the exit code, and the JSON result where there is one."""
    (tmp_path / "robot.yaml").write_text(ELBOW_ROBOT)
    monkeypatch.chdir(tmp_path)

    def fit(text, *options):
        (tmp_path / "data.csv").write_text(text)
        words = ["fit", "robot.yaml", "data.csv", "--json", "r.json", "--out", "m.json", *options]
        code = exit_codes.exit_code_of(lambda: app(words, standalone_mode=False))
        return code, json.loads((tmp_path / "r.json").read_text()) if code < 2 else {}

    return fit


def lengths(rng, count, anchor, zero="", arm=ARM):
    """Columns of `count` lengths to an anchor, of the wire that counts from `zero`."""
    readings = drawn(rng, count)
    away = np.linalg.norm(arm.tcp(readings) - ANCHORS[anchor], axis=1)
    shown = away + ZEROS.get(zero, 0.0) + rng.normal(0.0, NOISE_MM, count)
    cells = [*readings.T, [anchor] * count, shown, [zero] * count]
    return dict(zip(NAMES, cells, strict=True))


def joined(*parts, **more):
    """One data set of the parts, and of columns that only some of its last rows have filled."""
    rows = {name: [cell for part in parts for cell in part[name]] for name in NAMES}
    count = len(rows["A1"])
    filled = {name: [""] * (count - len(cells)) + cells for name, cells in more.items()}
    return csv_text(rows | filled)


def two_wires(rng, arm=ARM):
    return lengths(rng, 40, "left", "W1", arm), lengths(rng, 40, "right", "W2", arm)


@pytest.mark.long
def test_each_wires_zero_is_found_and_stands_in_model_and_page(fitted, tmp_path):
    rng = np.random.default_rng(1)
    text = joined(*two_wires(rng))
    code, result = fitted(text, "--model", "geometry", "--report", "fit.html")
    assert (code, result["verdict"]) == (0, "better")
    assert "datums" in result["groups"]
    assert result["test"]["mean"] < 0.02 < 0.2 < result["nominal"]["mean"]
    zeros = {zero.id: zero for zero in ModelFile.load(tmp_path / "m.json").datums}
    assert set(zeros) == set(ZEROS)
    for name, zero in zeros.items():
        assert zero.sigma < 0.5
        assert abs(zero.mm - ZEROS[name]) < 4.0 * zero.sigma
    page = (tmp_path / "fit.html").read_text()
    assert "W1, W2" in page
    assert f"{zeros['W1'].mm:.3f}" in page


def test_a_length_of_nothing_or_less_is_one_where_its_zero_is_not_known(fitted):
    rng = np.random.default_rng(2)
    wire = lengths(rng, 40, "left", "W1")
    wire["distance"] = wire["distance"] - 1500.0
    assert min(wire["distance"]) < 0.0
    code, result = fitted(joined(wire, lengths(rng, 40, "right")), "--model", "geometry")
    assert code == 0
    assert result["rejected"] == []


def test_rows_whose_zero_says_nothing_are_named_by_line(fitted):
    rng = np.random.default_rng(3)
    wires = two_wires(rng)
    alone = lengths(rng, 1, "left", "W3")
    alone["zero"] = ["W3"]
    place = {**lengths(rng, 1, "left", "W1"), "anchor": [""], "distance": [""]}
    text = joined(*wires, alone, place, X=[500.0], Y=[10.0], Z=[500.0])
    _, result = fitted(text, "--model", "geometry")
    reasons = {row["line"]: row["reason"] for row in result["rejected"]}
    assert reasons == {
        82: "one length only with zero 'W3': it cannot be distinguished from the zero; mistyped?",
        83: "zero 'W1' is of a distance from an anchor, and this is a position",
    }


def test_lengths_alike_but_for_their_zero_are_no_copies(fitted):
    rng = np.random.default_rng(4)
    wires = two_wires(rng)
    other = {**wires[0], "zero": ["other"] * 40}
    _, result = fitted(joined(*wires, other), "--model", "geometry")
    assert result["rejected"] == []
    _, result = fitted(joined(*wires, wires[0]), "--model", "geometry")
    assert len(result["rejected"]) == 40


def test_a_reversed_joint_is_found_among_lengths_of_unknown_zero(fitted, capsys):
    rng = np.random.default_rng(5)
    wires = two_wires(rng)
    turned = [{**wire, "A3": [-reading for reading in wire["A3"]]} for wire in wires]
    code, _ = fitted(joined(*turned), "--model", "geometry")
    assert code == 2
    assert "A3 reversed: RMS" in capsys.readouterr().err


def test_a_held_out_wire_is_judged_with_the_zero_that_its_own_rows_have(fitted):
    rng = np.random.default_rng(6)
    text = joined(*two_wires(rng), lengths(rng, 30, "left"))
    _, result = fitted(text, "--model", "geometry", "--by", "zero")
    assert result == {}  # the absolute lengths have no label: an empty cell is an error
    text = joined(*two_wires(rng))
    code, result = fitted(text, "--model", "geometry", "--by", "zero")
    assert code == 0
    assert {name: figures["rows"] for name, figures in result["by"].items()} == {"W1": 40, "W2": 40}
    assert all(figures["test"]["mean"] < 0.3 * figures["nominal"]["mean"] for figures in result["by"].values())
