"""Real measurements: sockets certified to be 50 mm apart, at each combination of three places, of two robots."""

import re
from itertools import combinations

import pytest

from cellctl.formats import DataSet, RobotFile
from cellctl.formats.measurements import measurements
from cellctl.formats.measurements._sessions import Spacing
from cellctl.setup_check import find_spacing_errors
from tests.helpers.real_data import DATA, PLACES, visits, with_ball

pytestmark = pytest.mark.skipif(not (DATA / "panda_sockets").exists(), reason=f"no sockets at {DATA}")

COMBINATIONS = [
    (robot, places) for robot, each in PLACES.items() for count in (1, 2, 3) for places in combinations(each, count)
]
FAST = [("panda", ("back-high",)), ("panda", ("right",)), ("panda", PLACES["panda"]), ("iiwa14", ("front",))]


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """The robot files with the ball as their tool."""
    folder = tmp_path_factory.mktemp("robots")
    return {robot: RobotFile.load(with_ball(robot, folder)) for robot in PLACES}


def named(robots, robot, places, folder, given):
    data = DataSet.load(visits(robot, places, folder / "visits.csv"))
    spacing = Spacing.parse(f"0,1={given}±0.05")
    return find_spacing_errors(measurements(robots[robot], data, model="geometry", spacings=[spacing]).task)


@pytest.mark.parametrize(
    ("robot", "places"),
    [pytest.param(*each, marks=() if each in FAST else pytest.mark.long) for each in COMBINATIONS],
)
def test_the_certified_spacing_is_accepted_and_a_wrong_one_refused(robots, robot, places, tmp_path):
    assert named(robots, robot, places, tmp_path, 50) == ()
    wrong = (47, 53) if "back-high" in places else (49, 51)  # the model extrapolates to it, and is off by 0.6 mm there
    for given in wrong:
        told = named(robots, robot, places, tmp_path, given)
        assert told
        for each in told:
            assert abs(each.estimate - 50.0) < each.least <= abs(given - each.estimate) < 4.0
            words = re.search(r"\(errors from ([\d.]+) mm are found\)", each.what)
            assert float(words[1]) == pytest.approx(each.least, rel=0.05)
