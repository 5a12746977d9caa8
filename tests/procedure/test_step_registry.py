"""Steps come from installed modules, loaded when asked for; a broken one is named and breaks no other."""

import re
import sys
import types
from pathlib import Path
from typing import Protocol

import pytest

from cellctl.devices import CellIO, CellReadings, Device, JointReader, MovingRobot, NoContact, TableStore, observes
from cellctl.files import parse_yaml
from cellctl.procedure import (
    BrokenSteps,
    CellFiles,
    NoInputs,
    StepContext,
    StepDescription,
    StepInputs,
    StepRegistry,
    StepResult,
    UnknownStep,
    check_cell,
    read_procedure,
    step,
)
from cellctl.procedure import registry as registry_module
from tests.helpers.runs import ROOT


class Depth(StepInputs):
    mm: float


class Found(StepResult):
    mm: float


@step("well.measure", moves=True)
async def measure(context: StepContext, inputs: Depth) -> Found:
    """Measure the well.

    Slowly.
    """
    return Found(mm=inputs.mm)


@step("well.leave")
async def leave(context: StepContext, inputs: NoInputs) -> None:
    """Leave it."""


def module(name, **members):
    made = types.ModuleType(name)
    vars(made).update(members)
    return made


class Point:
    """An entry point as the packaging metadata gives it."""

    dist = None

    def __init__(self, name, load, value=""):
        self.name, self.load, self.value = name, load, value or f"plugin.{name}"


@pytest.fixture
def installed(monkeypatch):
    """A registry of entry points made from name → loader."""

    def make(*points):
        monkeypatch.setattr(registry_module, "entry_points", lambda group: [Point(*point) for point in points])
        return StepRegistry.installed()

    return make


def fails():
    raise ModuleNotFoundError("No module named 'pylon'")


def test_a_kind_of_step_says_what_it_takes_gives_and_does():
    assert (measure.name, measure.summary, measure.moves) == ("well.measure", "Measure the well.", True)
    assert (measure.inputs, measure.result) == (Depth, Found)
    assert leave.result is None


def test_only_the_family_asked_for_is_imported(installed):
    registry = installed(("well", lambda: module("plugin.well", measure=measure)), ("camera", pytest.fail))
    assert registry.find("well.measure") is measure


def test_a_broken_package_is_named_and_leaves_the_others_alone(installed):
    registry = installed(("well", lambda: module("plugin.well", measure=measure)), ("camera", fails))
    assert registry.names() == ["well.measure"]
    for _ in range(2):
        with pytest.raises(BrokenSteps, match=r"plugin\.camera .* cannot be loaded: ModuleNotFoundError: .*'pylon'"):
            registry.find("camera.look")


def test_an_unknown_step_says_which_one_may_be_meant(installed):
    registry = installed(("well", lambda: module("plugin.well", measure=measure, leave=leave)))
    with pytest.raises(UnknownStep) as caught:
        registry.find("well.mesure")
    assert caught.value.cure == "did you mean 'well.measure'?"


def test_a_module_with_steps_of_another_family_is_refused(installed):
    registry = installed(("lake", lambda: module("plugin.lake", measure=measure)))
    with pytest.raises(BrokenSteps, match=r"'well\.measure' is not of this family"):
        registry.find("lake.measure")


def test_a_family_claimed_by_two_packages_is_refused_with_both_named(installed):
    registry = installed(("well", fails, "one.well"), ("well", fails, "another.well"))
    with pytest.raises(BrokenSteps, match=r"one\.well .* also claimed by another\.well"):
        registry.find("well.measure")


def test_a_family_seen_twice_is_one(installed):
    load = lambda: module("plugin.well", measure=measure)  # noqa: E731
    assert installed(("well", load), ("well", load)).find("well.measure") is measure


LISTED = StepDescription("well.measure", ".digging", "measuring the well", Depth, lambda known: 2 * known["mm"])


def test_a_described_step_is_imported_only_when_it_is_to_run(installed, monkeypatch):
    registry = installed(("well", lambda: module("plugin.well", STEPS=(LISTED,))))
    described = registry.describe("well.measure")
    assert (described.title, described.expects({"mm": 3})) == ("measuring the well", 6)
    monkeypatch.setitem(sys.modules, "plugin.well.digging", module("plugin.well.digging", measure=measure))
    found = registry.find("well.measure")
    assert (found.function, found.title, found.expects) == (measure.function, LISTED.title, LISTED.expects)


@pytest.mark.parametrize(
    ("members", "why"), [(None, "ModuleNotFoundError"), ({"leave": leave}, "has no step 'well.measure'")]
)
def test_a_described_step_that_its_module_does_not_have_is_named(members, why, installed, monkeypatch):
    registry = installed(("well", lambda: module("plugin.well", STEPS=(LISTED,), leave=leave)))
    if members:
        monkeypatch.setitem(sys.modules, "plugin.well.digging", module("plugin.well.digging", **members))
    with pytest.raises(BrokenSteps, match=rf"plugin\.well\.digging cannot be loaded: .*{why}"):
        registry.find("well.measure")
    assert registry.find("well.leave") is leave


def test_every_shipped_step_is_described_with_its_inputs():
    registry = StepRegistry.installed()
    names = registry.names()
    text = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "procedures" / "steps").rglob("*.py"))
    assert sorted(re.findall(r'@step\(\s*"([^"]+)"', text)) == names
    described = {name: registry.describe(name) for name in names}
    for name, each in described.items():
        assert not each.expects or registry.find(name).inputs is each.inputs


def test_our_own_steps_are_found_where_they_are_installed():
    assert "robot.stop" in StepRegistry.installed().names()


def test_errors_to_retry_after_are_those_of_devices_a_time_out_and_the_steps_own():
    class Slipped(Exception):
        pass

    async def climb(context: StepContext, inputs: NoInputs) -> None:
        """Climb."""

    known = step("well.climb", errors=(Slipped,))(climb).retryable()
    assert known["NoContact"] is NoContact
    assert known["TimeoutError"] is TimeoutError
    assert known["Slipped"] is Slipped


async def no_inputs_named(context: StepContext) -> None:
    """Do."""


async def untyped_result(context: StepContext, inputs: NoInputs):
    """Do."""


async def silent(context: StepContext, inputs: NoInputs) -> None: ...


def at_once(context: StepContext, inputs: NoInputs) -> None:
    """Do."""


class Loose(StepInputs, extra="allow"):
    """Takes anything."""


async def loose(context: StepContext, inputs: Loose) -> None:
    """Do."""


@pytest.mark.parametrize(
    ("name", "function", "why"),
    [
        ("measure", measure.function, "no name for a kind of step"),
        ("well.x", no_inputs_named, "has to take"),
        ("well.x", loose, "has to take"),
        ("well.x", untyped_result, "has to return"),
        ("well.x", silent, "no docstring"),
        ("well.x", at_once, "async"),
    ],
)
def test_a_function_that_fits_no_step_is_refused_when_it_is_made_one(name, function, why):
    with pytest.raises(TypeError, match=why):
        step(name)(function)


class Welder(Device, Protocol):
    """A device of somebody's own, of which nothing is declared."""


@observes
class Scale(Device, Protocol):
    """A device of somebody's own that only reads."""


@pytest.mark.parametrize(
    ("protocol", "moves"),
    [
        *((protocol, True) for protocol in (MovingRobot, Welder, CellIO, TableStore)),
        *((protocol, False) for protocol in (Device, JointReader, CellReadings, Scale)),
    ],
)
@pytest.mark.parametrize("how", ["needs", "uses"])
def test_a_step_moves_as_the_protocols_of_its_devices_declare_and_one_that_declares_nothing_moves(how, protocol, moves):
    @step("well.dig", **{how: {"device": protocol}})
    async def dig(context: StepContext, inputs: NoInputs) -> None:
        """Dig."""

    assert dig.moves is moves


def test_of_the_shipped_steps_those_that_only_read_or_stop_leave_nothing_uncertain():
    registry = StepRegistry.installed()
    observing = ("robot.stop", "tool.read_pose", "tracker.prepare", "tracker.two_face", "tracker.monuments")
    assert not any(registry.find(name).moves for name in observing)
    moving = ("sphere.touch", "sphere.push", "tracker.measure", "tracker.judge", "tracker.withdraw", "tool.touch")
    assert all(registry.find(name).moves for name in moving)


@pytest.mark.parametrize(
    ("hook", "why"), [(3, "not a callable"), (lambda: 3, "has to be a function of"), ("x", "not a callable")]
)
def test_an_expects_that_cannot_be_called_is_refused_when_the_step_is_made(hook, why):
    with pytest.raises(TypeError, match=f"(?s)step 'well.x'.*{why}"):
        step("well.x", expects=hook)(measure.function)


def test_an_expects_that_fails_is_an_error_at_its_step():
    @step("well.x", expects=lambda known: known["no such input"])
    async def expecting(context: StepContext, inputs: NoInputs) -> None:
        """Do."""

    text = "procedure: p\ntitle: t\nsteps:\n  - {id: a, do: well.x}\n"
    procedure = read_procedure(parse_yaml(text, "p.yaml"))
    context = CellFiles(parse_yaml("name: c", "c.yaml"), Path("r.yaml"), 1)
    (problem,) = check_cell(procedure, {}, StepRegistry([expecting]), context)
    assert (problem.file, problem.line) == ("p.yaml", 4)
    assert "`expects=` of step well.x failed: KeyError: 'no such input'" in problem.what
