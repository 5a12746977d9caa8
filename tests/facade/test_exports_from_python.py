"""`Model.to_…`: the files of `cellctl convert`, and its notes as warnings."""

import warnings

import pytest

import cellctl
from tests.helpers.arms import cellctl as command
from tests.helpers.arms import kr5_model, printed_errors


@pytest.fixture
def model(tmp_path, monkeypatch):
    kr5_model().save(tmp_path / "model.json")
    monkeypatch.chdir(tmp_path)
    return cellctl.load("model.json")


FORMS = {
    "urdf": ("to_urdf", {}, []),
    "dh-csv": ("to_dh", {"convention": "mdh-hayati"}, []),
    "dh-craig": ("to_robot_file", {"convention": "dh-craig"}, []),
    "kuka": ("to_kuka", {"tool_number": 3}, ["--tool-number", "3"]),
    "abb": ("to_abb", {}, []),
    "fanuc": ("to_fanuc", {}, []),
}


@pytest.mark.parametrize("form", FORMS)
def test_the_file_and_the_notes_are_those_of_convert(model, tmp_path, capsys, form):
    name, options, words = FORMS[form]
    assert command("convert", "model.json", "--to", form, "-o", "command", *words) == 0
    printed = capsys.readouterr().err.splitlines()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        content = getattr(model, name)("python", **options)
    assert (tmp_path / "python").read_bytes() == (tmp_path / "command").read_bytes()
    assert (content if isinstance(content, bytes) else content.encode()) == (tmp_path / "python").read_bytes()
    assert [f"cellctl: {each.message}" for each in told] == printed
    assert {each.filename for each in told} <= {__file__}


def test_a_form_that_the_robot_does_not_have_is_refused_as_by_convert(model, capsys):
    assert command("convert", "model.json", "--to", "ur-calibration") == 2
    printed = printed_errors(capsys)
    with pytest.raises(cellctl.InputError) as refused:
        model.to_ur_calibration()
    assert str(refused.value).strip() == printed


def test_a_convention_that_does_not_exist_is_refused(model):
    for write in (model.to_dh, model.to_robot_file):
        with pytest.raises(cellctl.InputError, match="convention: 'classic' is not known"):
            write(convention="classic")
