"""`cellctl.fit` and the model give the results and the errors of the command line."""

import json

import numpy as np
import pytest

import cellctl
from tests.helpers.arms import cellctl as command
from tests.helpers.arms import printed_errors

OPTIONS = [
    ({}, []),
    ({"model": "geometry", "holdout": 0.3, "seed": 3}, ["--model", "geometry", "--holdout", "0.3", "--seed", "3"]),
    ({"model": "zeros", "folds": 4, "own": "none"}, ["--model", "zeros", "--folds", "4", "--own", "none"]),
    ({"model": "geometry", "by": "set", "measure": "position"}, ["--model=geometry", "--by=set", "--measure=position"]),
]


def by_command(files, *words):
    """The JSON of the command, without its time, and the bytes of its model."""
    command("fit", "robot.yaml", "data.csv", *words, "--json", "result.json", "--out", "command.json")
    result = json.loads((files / "result.json").read_text())
    result.pop("seconds")
    return result, (files / "command.json").read_bytes()


@pytest.mark.parametrize(("options", "words"), OPTIONS, ids=lambda each: str(each)[:40])
def test_report_and_model_file_are_those_of_the_command(files, options, words):
    report, model = by_command(files, *words)
    fitted = cellctl.fit("robot.yaml", "data.csv", **options)
    assert fitted.report == report
    assert (fitted.verdict, fitted.sentence) == (report["verdict"], report["sentence"])
    fitted.save("python.json")
    assert (files / "python.json").read_bytes() == model


@pytest.mark.long
def test_a_comparison_is_that_of_the_command(files, tmp_path):
    command("fit", "robot.yaml", "data.csv", "--compare", "zeros", "--folds", 4, "--json", "result.json")
    result = json.loads((files / "result.json").read_text())
    found = cellctl.compare("robot.yaml", "data.csv", "zeros", folds=4)
    assert untimed(found.report) == untimed(result)
    assert [model["choice"] for model in found.models] == ["auto", "zeros"]
    assert found.sentence == result["sentence"]
    assert found.page(tmp_path / "page.html") == (tmp_path / "page.html").read_text()


def test_a_comparison_with_a_model_of_no_such_name_is_refused(files):
    with pytest.raises(cellctl.InputError, match="zeroes"):
        cellctl.compare("robot.yaml", "data.csv", ["zeroes"])


def untimed(report):
    return {**report, "models": [{**model, "seconds": None} for model in report["models"]]}


def test_options_may_be_numpy_scalars_and_lists_of_names(files):
    plain = cellctl.fit("robot.yaml", "data.csv", model="zeros", holdout=0.25, seed=3, own="base,tool")
    numpy = {"holdout": np.float64(0.25), "seed": np.int64(3), "own": ["base", "tool"]}
    assert cellctl.fit("robot.yaml", "data.csv", model="zeros", **numpy).report == plain.report


def test_arrays_give_the_model_of_the_file_that_to_csv_writes(files, columns):
    data = cellctl.read(columns)
    fitted = cellctl.fit(cellctl.robot("robot.yaml"), data, model="geometry")
    data.to_csv("data.csv")
    report, model = by_command(files, "--model", "geometry")
    assert fitted.report == report
    fitted.save("python.json")
    assert (files / "python.json").read_bytes() == model


def test_a_prior_model_may_be_a_file_or_a_model(files, columns):
    before = cellctl.fit("robot.yaml", "data.csv", model="geometry").save("model.json")
    ten = cellctl.read({name: values[:12] for name, values in columns.items() if name != "set"})
    ten.to_csv("data.csv")
    report, _ = by_command(files, "--prior", "model.json", "--folds", "3")
    for prior in ("model.json", before):
        assert cellctl.fit("robot.yaml", ten, prior=prior, folds=3).report == report


@pytest.mark.long
def test_the_page_is_that_of_the_command(files):
    command("fit", "robot.yaml", "data.csv", "--model", "geometry", "--report", "command.html")
    page = cellctl.fit("robot.yaml", "data.csv", model="geometry").page("python.html")
    assert page == (files / "command.html").read_text() == (files / "python.html").read_text()


def test_progress_reports_the_fit(files):
    told = []
    cellctl.fit("robot.yaml", "data.csv", model="geometry", progress=lambda doing, share: told.append((doing, share)))
    assert {doing.partition(":")[0] for doing, _ in told} >= {"fit"}
    assert all(0.0 <= share <= 1.0 for _, share in told)


def test_predictions_are_those_of_the_command(files, columns):
    model = cellctl.fit("robot.yaml", "data.csv", model="geometry").save("model.json")
    command("predict", "model.json", "data.csv", "-o", "command.csv")
    q = np.column_stack([columns[name] for name in ("A1", "A2", "A3")])
    for joints in (q, q.tolist(), "data.csv", {name: columns[name] for name in ("A1", "A2", "A3")}):
        model.predict(joints).to_csv("python.csv")
        assert (files / "python.csv").read_bytes() == (files / "command.csv").read_bytes()


def test_a_loaded_model_predicts_as_the_fitted_one(files):
    fitted = cellctl.fit("robot.yaml", "data.csv", model="geometry").save("model.json")
    loaded = cellctl.load("model.json")
    assert (loaded.verdict, loaded.file) == (fitted.verdict, fitted.file)
    np.testing.assert_array_equal(loaded.predict([0, -30, -60]).poses, fitted.predict([0, -30, -60]).poses)
    with pytest.raises(cellctl.InputError, match=r"model\.json: has no measured rows"):
        loaded.page()


WRONG = [
    ({"holdout": 2.0, "folds": 1}, ["--holdout", "2", "--folds", "1"]),
    ({"measure": "length", "model": "geometri", "own": "bass"}, ["--measure=length", "--model=geometri", "--own=bass"]),
    ({"column": "kind"}, ["--column", "kind"]),
    ({"by": "day"}, ["--by", "day"]),
    ({"prior": "nothing.json", "artefact": "none.yaml"}, ["--prior", "nothing.json", "--artefact", "none.yaml"]),
    ({"spacing": "A-B", "free": "zeros", "model": "zeros"}, ["--spacing=A-B", "--free=zeros", "--model=zeros"]),
]


@pytest.mark.parametrize(("options", "words"), WRONG, ids=lambda each: str(each)[:40])
def test_errors_of_a_call_are_those_of_the_command(files, capsys, options, words):
    assert command("fit", "robot.yaml", "data.csv", *words) == 2
    printed = printed_errors(capsys)
    with pytest.raises(cellctl.InputError) as refused:
        cellctl.fit("robot.yaml", "data.csv", **options)
    assert str(refused.value) == printed


@pytest.mark.long
def test_a_set_up_error_is_reported_as_by_the_command(files, capsys, columns):
    cellctl.read({**columns, "A3": -np.array(columns["A3"])}).to_csv("data.csv")
    assert command("fit", "robot.yaml", "data.csv") == 2
    printed = printed_errors(capsys)
    with pytest.raises(cellctl.InputError) as refused:
        cellctl.fit("robot.yaml", "data.csv")
    assert str(refused.value).strip() == printed
    assert "A3" in printed


def test_swapped_files_are_recognised(files):
    with pytest.raises(cellctl.InputError, match="they are swapped"):
        cellctl.fit("data.csv", "robot.yaml")


def test_a_negative_seed_is_refused(files):
    with pytest.raises(cellctl.InputError, match="--seed: -1 is negative"):
        cellctl.fit("robot.yaml", "data.csv", holdout=0.3, seed=-1)
