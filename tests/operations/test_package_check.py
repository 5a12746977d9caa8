"""`cellctl check --package` names all that is wrong with an extension; the example packages have nothing wrong."""

import os
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from cellctl.cli.verbs import app
from cellctl.clock import WallClock
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError
from cellctl.installed import shipped
from cellctl.operations.package_check import check_package
from tests.helpers.examples import EXAMPLES, paths_of
from tests.helpers.runs import ROOT

PYPROJECT = """
[project]
name = "broken-kit"
version = "1"

[project.entry-points."cellctl.devices"]
"scale+tcp" = "broken_kit.driver:DRIVER"

[project.entry-points."cellctl.device"]
scale = "broken_kit.driver:DRIVER"

[project.entry-points."cellctl.steps"]
scale = "broken_kit.steps"

[project.entry-points."cellctl.effects"]
sag = "broken_kit.effect:Sag"
gone = "broken_kit.effect:Gone"

[project.entry-points."cellctl.compensation_methods"]
scale = "broken_kit.effect:METHOD"

[project.entry-points."cellctl.report_sections"]
scale = "broken_kit.steps:weigh"
"""

DRIVER = '''
"""A driver with faults."""

from typing import Protocol

from cellctl.devices import Device, DriverDescription, observes


@observes
class Weigher(Device, Protocol):
    """A device that weighs."""

    async def weight(self, times: int) -> float:
        """The weight, kg."""

    async def tare(self) -> None:
        """Set it to zero."""


class Scale:
    def __init__(self, name):
        self.name = name

    async def connect(self):
        """Connect."""

    async def health(self):
        """Health."""

    async def close(self):
        """Close."""

    def stop(self):
        """Stop."""

    async def weight(self):
        """Weigh."""


def open_scale(name, address, surroundings) -> Scale:
    """Open it."""
    return Scale(name)


DRIVER = DriverDescription(open=open_scale, abilities=Weigher)
'''

STEPS = '''
"""Steps with faults."""

from dataclasses import dataclass
from typing import ClassVar

from cellctl.procedure import NoInputs, StepContext, step
from cellctl.records import Row


@dataclass
class WeightRow:
    """Another module's."""


@dataclass(frozen=True)
class Weight(Row):
    """A weight, kg."""

    KIND: ClassVar[str] = "broken_kit_weight"
    kg: float


class Tare(Row):
    KIND: ClassVar[str] = "broken_kit_weight"


@step("scale.weigh")
async def weigh(context: StepContext, inputs: NoInputs) -> None:
    """Weigh."""


@step("scale.weigh")
async def weigh_again(context: StepContext, inputs: NoInputs) -> None:
    """Weigh again."""
'''

EFFECT = '''
"""An effect and a method with faults."""

from cellctl.calibration import Effect
from cellctl.compensation import Method


class Sag(Effect):
    """Sag."""

    group = "backlash"
    title = "Sag"


def one_pass(controller, robot):
    """A pass."""


METHOD = Method(one_pass)
'''

PROCEDURE = """
procedure: weighing
title: Weigh twice
steps:
  - {id: weigh, do: scale.weigh, timeout: 10}
  - {id: weigh, do: scale.weigh, timeout: 10}
"""

CELL = """
name: scale cell
model: kr5_r1400
devices:
  scale: scale+tcp://10.0.0.9:7000
"""

WRONG = [
    "cellctl.device: scale = broken_kit.driver:DRIVER: is in a group that cellctl does not read",
    "did you mean cellctl.devices?",
    "cellctl.effects: gone = broken_kit.effect:Gone: cannot be loaded: AttributeError",
    "cellctl.report_sections: scale = broken_kit.steps:weigh: is a StepKind, and a ReportSection is expected",
    "Scale has no docstring",
    "Scale has no tare(self) -> None of Weigher",
    "Scale.stop has to be async, as Weigher declares it",
    "Scale.weight(self) does not take what Weigher gives",
    "two functions are the step 'scale.weigh'",
    "Tare has no docstring",
    "Tare is no frozen dataclass",
    "Tare has the KIND 'broken_kit_weight' of broken_kit.steps.Weight",
    "Sag lacks of_inputs, parameters, sigma",
    "is not used: another effect has the name 'backlash'",
    "`correction` cannot be called with (controller, robot, targets, now)",
    "scale: the driver of 'scale+tcp://' declares no limits",
    "weighing.yaml:6:10: ",
]


@pytest.fixture
def broken(tmp_path, monkeypatch):
    project = tmp_path / "project"
    (project / "broken_kit" / "cells").mkdir(parents=True)
    (project / "pyproject.toml").write_text(PYPROJECT)
    files = {"__init__": "", "driver": DRIVER, "steps": STEPS, "effect": EFFECT}
    for name, text in files.items():
        (project / "broken_kit" / f"{name}.py").write_text(text)
    (project / "broken_kit" / "weighing.yaml").write_text(PROCEDURE)
    (project / "broken_kit" / "cells" / "scale_cell.yaml").write_text(CELL)
    for place in paths_of(project, tmp_path / "site"):
        monkeypatch.syspath_prepend(place)


def test_all_that_is_wrong_is_named_at_once_with_its_place(broken):
    told = "\n".join(map(str, check_package("broken-kit").problems))
    assert [text for text in WRONG if text not in told] == [], told


def test_a_package_that_is_not_installed_or_extends_nothing_is_named():
    with pytest.raises(InputError, match=r"is no installed package(?s:.*)pip install"):
        check_package("no-such-kit")
    with pytest.raises(InputError, match="has no entry point in a group"):
        check_package("numpy")


def test_the_command_takes_a_procedure_or_a_package():
    for words in (["check"], ["check", "sphere_selfcal", "--package", "cellctl"]):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 2
        assert "name a procedure, or a package with --package" in done.output


def test_every_shipped_driver_refuses_a_limit_that_it_does_not_have():
    drivers, refused = DriverRegistry(), set()
    for file in shipped("cell").values():
        cell = Cell.load(file, drivers)
        for name, address in cell.addresses.items():
            given = replace(cell.surroundings(name, WallClock()), limits={"sped_deg_s": 1.0})
            assert not all(finding.warning for finding in drivers.findings(name, address, given)), f"{file}: {name}"
            refused.add(address.scheme)
    assert len(refused) >= 6


@pytest.mark.long
@pytest.mark.parametrize("name", ["dial_gauge", "calibration_kit"])
def test_the_example_packages_have_nothing_wrong(name, tmp_path, monkeypatch):
    places = paths_of(EXAMPLES / name, tmp_path)
    for place in places:
        monkeypatch.syspath_prepend(place)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([*places, str(ROOT)]))  # the simulators are another process
    if name == "calibration_kit":
        monkeypatch.setattr("cellctl.operations.package_check.KINDS", {})  # of this process, which began without it
    assert check_package(name).problems == ()
