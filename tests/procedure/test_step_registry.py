"""Steps come from installed modules, loaded when asked for; a broken one is named and breaks no other."""

import types

import pytest

from cellctl.devices import NoContact
from cellctl.procedure import (
    BrokenSteps,
    NoInputs,
    StepContext,
    StepInputs,
    StepRegistry,
    StepResult,
    UnknownStep,
    step,
)
from cellctl.procedure import registry as registry_module


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
