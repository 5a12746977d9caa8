"""The console's example of a data set: simulated, as its page says, and good enough to show what a fit does."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.operations import analyses
from tests.helpers import simulated_data


def test_the_example_is_what_the_simulated_world_gives() -> None:
    shipped = np.loadtxt(analyses.EXAMPLE, delimiter=",", skiprows=1)
    made = np.array([[*joints, *place] for joints, place in simulated_data.example_rows()])
    np.testing.assert_allclose(shipped, made, atol=6e-4)


@pytest.mark.long
def test_the_example_is_understood_and_its_robot_becomes_better(tmp_path) -> None:
    folder, record = analyses.new_analysis(tmp_path, "Ada", analyses.EXAMPLE.name)
    (folder / record.data).write_bytes(analyses.EXAMPLE.read_bytes())
    analyses.set_robot(folder, analyses.EXAMPLE_ROBOT)
    found = analyses.understand_analysis(folder)
    assert (found["usable"], found["problems"], found["doubt"]) == (100, [], "")
    assert analyses.fit_analysis(folder, analyses.FitSettings(model="geometry")).verdict == "better"
