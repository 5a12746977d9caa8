"""The source of motor currents that a step gets."""

import asyncio

from cellctl.devices import MotorCurrents
from cellctl.files import load_yaml
from procedures.steps.tracker.measuring import current_source
from tests.helpers.steps import Context


class Drives:
    """Gives the same currents for every call."""

    async def currents(self, samples):
        return MotorCurrents((1.0, -2.0), (0.1, 0.2), samples, 77)


def test_scale_and_offset_of_the_cell_file_are_applied_once(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text("devices: {robot: 'a://b'}\ncurrents: {source: robot, scale: [2, -1], offset: [0.5, 0]}\n")
    source = current_source(Context(robot=Drives(), cell=load_yaml(path)), 2)
    assert asyncio.run(source.currents(5)) == MotorCurrents((2.5, 2.0), (0.2, 0.2), 5, 77)


def test_a_cell_without_currents_has_no_source(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text("devices: {robot: 'a://b'}\n")
    assert current_source(Context(cell=load_yaml(path)), 6) is None
