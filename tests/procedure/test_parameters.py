"""Parameters are what the file or the operator says, of one type each, within their range."""

import pytest

from cellctl.files import InputError
from cellctl.procedure import resolve_parameters


def refused(procedure, *settings):
    with pytest.raises(InputError) as caught:
        resolve_parameters(procedure, settings)
    return [str(problem) for problem in caught.value.problems]


def test_defaults_hold_where_nothing_is_set(load, good):
    values = resolve_parameters(load(good))
    assert values == {"touches_fit": 50, "search_speed": 5.0, "order": "random", "quick": False}
    assert isinstance(values["search_speed"], float)


def test_settings_win_and_have_the_parameters_type(load, good):
    values = resolve_parameters(load(good), ["touches_fit=80", "search_speed = 2", "order=nearest", "quick=true"])
    assert values == {"touches_fit": 80, "search_speed": 2.0, "order": "nearest", "quick": True}
    assert isinstance(values["search_speed"], float)


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("touches_fit=80.5", "'touches_fit' takes a whole number (here: '80.5')\n    give a whole number, 10 touches"),
        (f"touches_fit={'9' * 5000}", "'touches_fit' takes a whole number"),
        ("touches_fit=9", "'touches_fit' is out of its range (here: 9)"),
        ("search_speed=nan", "'search_speed' takes a number"),
        ("search_speed=inf", "'search_speed' takes a number"),
        ("search_speed=20.1", "'search_speed' is out of its range (here: 20.1)"),
        ("order=backwards", "'order' has no choice 'backwards'\n    known here: nearest, random"),
        ("quick=yes", "'quick' takes true or false (here: 'yes')"),
        ("touchesfit=80", "procedure 'sphere_selfcal' has no parameter 'touchesfit'\n    did you mean 'touches_fit'?"),
        ("touches_fit", "is no setting\n    write --set name=value"),
    ],
)
def test_a_setting_that_does_not_fit_is_refused_with_what_does(load, good, setting, expected):
    assert refused(load(good), setting)[0].startswith(f"--set {setting}: {expected}")


def test_all_wrong_settings_are_named_at_once(load, good):
    assert len(refused(load(good), "touches_fit=1", "x=2", "quick=true", "quick=false")) == 3


def test_a_parameter_without_default_has_to_be_given(load, good):
    procedure = load(good.replace("default: 50, ", ""))
    assert refused(procedure)[0].startswith(
        "procedures/p.yaml:5:16: 'touches_fit' has no default and was not given\n    add --set touches_fit=…"
    )
    assert resolve_parameters(procedure, ["touches_fit=12"])["touches_fit"] == 12
