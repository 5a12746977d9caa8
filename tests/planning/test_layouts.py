"""Layouts: an exchange against all layouts of few places, nests against a closed form, and the command's lines."""

from __future__ import annotations

import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.files import load_yaml
from cellctl.formats import artefact_of
from cellctl.planning.layouts import best_layout, error_by_nests
from tests.helpers.runs import CELL
from tests.helpers.simulated_data import TRACKER_CELL


def test_no_single_move_is_better_than_the_layout_found_and_impossible_ones_are_never_taken() -> None:
    points = np.random.default_rng(3).uniform(size=(9, 2))

    def error(layout: tuple[int, ...]) -> float:
        if 4 in layout:
            return float("inf")
        return 1.0 / float(np.linalg.norm(points[list(layout)] - points[list(layout)].mean(axis=0)))

    found, least = best_layout((0, 1, 2), 9, error)
    assert 4 not in found
    assert least == error(found)
    assert least <= 1.02 * min(error(each) for each in combinations(range(9), 3))


def test_far_nests_hold_the_turn_of_the_instrument_better() -> None:
    """Four nests at ±r along two axes, each with σ: turn about the third σ/(2 r), shift σ/2 on each axis."""
    cross = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    sigma = np.full(4, 0.02)
    for radius in (1000.0, 3000.0):
        at_origin = error_by_nests(radius * cross, sigma, np.zeros((1, 3)))
        assert at_origin == pytest.approx(0.02 / 2.0 * np.sqrt(3.0), rel=1e-6)
        far = error_by_nests(radius * cross, sigma, np.array([[2000.0, 0.0, 0.0]]))
        turns = (0.02 / (2.0 * radius)) ** 2 + (0.02 / (np.sqrt(2.0) * radius)) ** 2  # about z, and about y
        assert far**2 == pytest.approx(at_origin**2 + 2000.0**2 * turns, rel=1e-4)


@pytest.fixture
def cellctl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


@pytest.mark.long
def test_spheres_of_a_layout_are_read_back_and_promise_less_error_than_todays(cellctl) -> None:
    words = ("plan", "kr5_r1400", "--n", 35, "--layout", CELL, "--places", 6)
    assert cellctl(*words, "-o", "places.yaml", "--json", "found.json") == 0
    (found,) = json.loads(Path("found.json").read_text())["layouts"]
    assert found["planned_mm"] <= found["today_mm"]
    planned, today = (artefact_of(load_yaml(file), ("artefact",)) for file in (Path("places.yaml"), CELL))
    assert [each.id for each in planned.spheres] == [each.id for each in today.spheres]
    assert planned.place("P1") == today.place("P1"), "the proof sphere has no certificate, and stays"
    place = {each.id: np.array(each.centre) for each in planned.spheres}
    for one in planned.distances:
        a, b = one.between
        assert one.mm == pytest.approx(np.linalg.norm(place[a] - place[b]), abs=1e-3)
    gaps = [np.linalg.norm(a - b) for a, b in combinations(place.values(), 2)]
    assert min(gaps) >= 200.0


@pytest.mark.long
def test_certified_nests_stay_and_the_lines_name_the_station_once(cellctl) -> None:
    assert cellctl("plan", "kr5_r1400", "--n", 30, "--layout", TRACKER_CELL, "--places", 8, "-o", "places.yaml") == 0
    planned, today = load_yaml(Path("places.yaml")).data, load_yaml(TRACKER_CELL).data
    nests = {each["id"]: each["xyz"] for each in planned["station"]["nests"]}
    before = {each["id"]: each["xyz"] for each in today["station"]["nests"]}
    assert set(nests) == set(before)
    assert [nests[name] for name in ("N1", "N4")] == [before[name] for name in ("N1", "N4")]


def test_a_cell_with_nothing_to_place_and_options_of_targets_are_refused(cellctl, tmp_path, capsys) -> None:
    empty = tmp_path / "cell.yaml"
    empty.write_text("name: empty\nmodel: kr5_r1400.yaml\n")
    assert cellctl("plan", "kr5_r1400", "--n", 35, "--layout", empty) == 2
    assert "has nothing to be placed" in capsys.readouterr().err
    assert cellctl("plan", "kr5_r1400", "--n", 35, "--layout", CELL, "--box", "0:1,0:1,0:1") == 2
    assert "--box: is for targets, not for a layout" in capsys.readouterr().err
