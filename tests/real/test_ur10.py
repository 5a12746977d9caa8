"""Real measurements: 3000 held-out tracker points of a UR10, by way of the documented snippet and the command line."""

import json
import re
import runpy
import shutil
from pathlib import Path

import pytest

from cellctl.cli import ends
from cellctl.cli.verbs import app

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"

pytestmark = pytest.mark.skipif(not DATA.exists(), reason=f"the UR10 measurements are not at {DATA}")


def cellctl(*arguments):
    return ends.exit_code_of(lambda: app([str(argument) for argument in arguments], standalone_mode=False))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the snippet of the documentation has made `ur10.csv`."""
    made = tmp_path_factory.mktemp("ur10")
    document = (ROOT / "docs" / "reference" / "data-sets.md").read_text()
    (made / "snippet.py").write_text(re.search(r"```python\n(.*?)```", document, re.DOTALL).group(1))
    shutil.copy(DATA, made / DATA.name)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(made)
        runpy.run_path("snippet.py")
    return made


@pytest.fixture(scope="module")
def result(folder):
    robot = ROOT / "procedures" / "robots" / "ur10.yaml"
    options = ["--measure", "position", "--model", "geometry", "--out", folder / "m.json", "--json", folder / "r.json"]
    assert cellctl("fit", robot, folder / "ur10.csv", *options) == 0
    return json.loads((folder / "r.json").read_text())


def test_identified_geometry_halves_the_error_at_points_never_seen(result):
    assert (result["n_fit"], result["n_test"]) == (800, 3000)
    assert result["test"]["mean"] <= 0.40
    assert 0.70 <= result["nominal"]["mean"] <= 0.80
    assert result["verdict"] == "better"


@pytest.mark.long
def test_auto_is_no_worse_and_says_what_it_kept(folder, result):
    robot = ROOT / "procedures" / "robots" / "ur10.yaml"
    assert cellctl("fit", robot, folder / "ur10.csv", "--measure", "position", "--json", folder / "a.json") == 0
    auto = json.loads((folder / "a.json").read_text())
    assert auto["test"]["mean"] <= result["test"]["mean"]
    assert [step["model"] for step in auto["ladder"] if step["kept"]][:2] == ["geometry", "compliance"]


def test_the_foretold_error_is_the_one_found(result):
    assert result["predicted_test_rms"] == pytest.approx(result["test"]["rms"], rel=0.05)
    assert 0.90 <= result["coverage_95"] <= 0.98


def test_a_reflector_on_the_last_axis_leaves_its_zero_unseen(result):
    assert any(words.startswith("θ6 with tool") for words in result["unobservable"])


def test_the_model_predicts_the_held_out_points(folder, result):
    import csv
    import math

    out = folder / "tcp.csv"
    assert cellctl("predict", folder / "m.json", folder / "ur10.csv", "-o", out) == 0
    measured = list(csv.DictReader((folder / "ur10.csv").open()))
    said = list(csv.DictReader(out.open()))
    errors = [
        math.dist([float(a[k]) for k in "XYZ"], [float(b[k]) for k in "XYZ"])
        for a, b in zip(said, measured, strict=True)
        if b["set"] == "test"
    ]
    assert sum(errors) / len(errors) == pytest.approx(result["test"]["mean"], abs=1e-6)
