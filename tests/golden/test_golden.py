"""Figures, exit codes, result files and journals stay what they were: see `golden_outputs`."""

import importlib.util
import json
import shutil
from pathlib import Path

import pytest

from cellctl.files import sha256_of

_SPEC = importlib.util.spec_from_file_location("golden_outputs", Path(__file__).with_name("golden_outputs.py"))
golden = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(golden)


@pytest.fixture
def folder(tmp_path):
    """The inputs, in a folder that outputs may be written to."""
    return Path(shutil.copytree(golden.INPUTS, tmp_path / "golden"))


def same(name, output):
    found = golden.differences(golden.read_expected(name), output)
    assert not found, f"{len(found)} differences: {found[:5]}"


def test_a_fit_of_positions_and_its_update_with_a_prior_model(folder):
    same("positions", golden.fit_output(folder, "positions"))
    same("partial", golden.fit_output(folder, "partial"))
    updated = json.loads((folder / "partial.model.json").read_text())
    assert updated["provenance"]["prior_sha256"] == sha256_of((folder / "positions.model.json").read_bytes())


@pytest.mark.long
def test_a_fit_of_poses_what_it_predicts_and_its_compensated_targets(folder):
    same("poses", golden.fit_output(folder, "poses"))
    same("predicted", golden.predicted(folder))


@pytest.mark.long
def test_a_fit_of_touches(folder):
    same("touches", golden.fit_output(folder, "touches"))


@pytest.mark.long
@pytest.mark.parametrize("name", ["positions_folds", "harmonics"])
def test_a_fit_with_folds_and_one_with_harmonics(folder, name):
    same(name, golden.fit_output(folder, name))


def test_what_is_refused_ends_with_the_same_exit_code(folder):
    same("refusals", {name: golden.cellctl(folder, *words) for name, words in golden.REFUSALS.items()})


@pytest.mark.campaign
def test_a_seeded_run_its_result_model_data_set_and_journal(folder):
    same("run", golden.run_output(folder))
