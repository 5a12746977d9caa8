"""The load that a cell file states."""

import pytest

from cellctl.files import InputError, load_yaml
from cellctl.formats.load import Load, load_of


@pytest.fixture
def loaded(tmp_path):
    def load(text):
        path = tmp_path / "cell.yaml"
        path.write_text(text)
        return load_of(load_yaml(path))

    return load


def test_a_load_has_mass_centre_of_gravity_and_the_controllers_option(loaded):
    found = loaded("load: {name: LOAD1, mass: 5, xyz: [20, 0, 90], absolute_accuracy: true}")
    assert found == Load(name="LOAD1", mass=5.0, xyz=[20.0, 0.0, 90.0], absolute_accuracy=True)


def test_without_its_section_nothing_is_said_of_the_load(loaded):
    assert loaded("name: cell") is None


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("load: {mass: -1, xyz: [0, 0, 0]}", "cell.yaml:1:14"),
        ("load: {mass: 5}", "load"),
        ("load: {mass: 5, xyz: [0, 0], name: A}", "cell.yaml:1:"),
        ("load:\n  mass: 5\n  xyz: [0, 0, 0]\n  absolute: true", "cell.yaml:4:3"),
    ],
)
def test_a_wrong_load_is_refused_with_its_place(loaded, text, place):
    with pytest.raises(InputError) as caught:
        loaded(text)
    assert place in str(caught.value)
