"""The cell file's `currents:`."""

import pytest

from cellctl.files import InputError, load_yaml
from cellctl.formats.cell_sections import currents_of

CELL = "name: cell\ndevices: {robot: 'a://b', drives: 'c://d'}\ncurrents: "


@pytest.fixture
def read(tmp_path):
    def of(text, axes=6):
        path = tmp_path / "cell.yaml"
        path.write_text(CELL + text + "\n")
        return currents_of(load_yaml(path), axes)

    return of


def test_scale_and_offset_of_each_axis_are_applied(read):
    currents = read("{source: drives, scale: [1, -2, 0.5], offset: [0, 0.25, 1]}", axes=3)
    assert currents.source == "drives"
    assert currents.applied((1.0, 2.0, 4.0)) == (1.0, -3.75, 3.0)
    assert currents.applied_sigma((0.1, 0.1, 0.1)) == pytest.approx((0.1, 0.2, 0.05))


def test_without_them_the_currents_are_as_the_device_has_them(read):
    assert read("{source: robot}").applied((1.0,) * 6) == (1.0,) * 6


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("{source: plc}", r"cell\.yaml:3:\d+: .*source"),
        ("{source: drives, scale: [1, 1]}", r"cell\.yaml:3:\d+: 2 values for 6 axes"),
        ("{source: drives, offset: [1, 1, 1, 1, 1, 1, 1]}", r"7 values for 6 axes"),
        ("{source: drives, scale: [1, 1, 1, 0, 1, 1]}", r"a scale of 0 loses the current"),
        ("{scale: [1, 1, 1, 1, 1, 1]}", r"source"),
        ("{source: drives, factor: [1]}", r"factor"),
    ],
)
def test_an_error_is_named_with_its_place(read, text, what):
    with pytest.raises(InputError, match=what):
        read(text)
