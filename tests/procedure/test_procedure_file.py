"""A procedure file becomes a model that knows its places; no file, however strange, crashes the reader."""

import asyncio
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError, parse_yaml
from cellctl.installed import shipped
from cellctl.procedure import (
    Loop,
    OnResume,
    Reference,
    Retry,
    Step,
    StepRegistry,
    check,
    inputs_of,
    load_procedure,
    read_procedure,
    step_path,
    walk,
)

WORDS = ["steps", "cleanup", "id", "do", "with", "for_each", "as", "retry", "on", "attempts", "timeout", "parameters"]


def test_steps_know_what_to_do_with_what_how_long_and_where_they_stand(load, good):
    procedure = load(good)
    plan, loop = procedure.steps
    assert isinstance(plan, Step)
    assert isinstance(loop, Loop)
    assert (plan.inputs["fit"], plan.timeout_s, plan.line, plan.column) == (Reference("touches_fit"), 10.0, 10, 5)
    assert (loop.for_each, loop.variable) == (Reference("plan", ("touches",)), "touch")
    touch = loop.steps[0]
    assert isinstance(touch, Step)
    assert (touch.retry, touch.on_resume) == (Retry(2, ("NoContact",)), OnResume.SKIP)
    assert [action.id for action in walk((*procedure.steps, *procedure.cleanup))] == ["plan", "points", "touch", "hold"]


def test_the_cell_is_found_from_the_procedures_folder(tmp_path, good):
    path = tmp_path / "p.yaml"
    path.write_text(good)
    assert load_procedure(path).cell == tmp_path / "../cells/sphere_cell.yaml"


def test_a_cell_may_be_a_shipped_one_by_its_name_unless_a_file_has_it(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("procedure: mine\ntitle: mine\ncell: sphere_cell\nsteps: []\n")
    assert load_procedure(path).cell == shipped("cell")["sphere_cell"]
    (tmp_path / "sphere_cell").touch()
    assert load_procedure(path).cell == tmp_path / "sphere_cell"


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_procedure(tmp_path / "none.yaml")


def test_a_steps_identity_is_its_path_with_loop_indices():
    assert step_path(step_path("", "points", 17), "touch") == "points[17].touch"


def test_inputs_are_the_model_with_references_followed(load, good, registry):
    procedure = load(good)
    loop = procedure.steps[1]
    scope = {"touch": {"joints": [1.5], "name": "S1"}, "search_speed": 5.0}
    inputs = inputs_of(procedure, loop.steps[0], registry.find("sphere.touch"), scope)
    assert inputs.touch.joints == [1.5]
    assert inputs.speed_mm_s == 5.0


def test_inputs_that_turn_out_wrong_in_the_run_are_placed_in_the_file(load, good, registry):
    procedure = load(good)
    scope = {"touch": {"joints": ["one"], "name": "S1"}, "search_speed": 5.0}
    with pytest.raises(InputError, match=r"p\.yaml:20:23: input 'touch\.joints\.0' of sphere.touch: has to be"):
        inputs_of(procedure, procedure.steps[1].steps[0], registry.find("sphere.touch"), scope)
    with pytest.raises(InputError, match=r"p\.yaml:20:15: \$\{touch\}: 'touch' is not known here"):
        inputs_of(procedure, procedure.steps[1].steps[0], registry.find("sphere.touch"), {"search_speed": 5.0})


def test_a_result_goes_to_later_steps_as_the_journal_keeps_it(load, good, registry):
    procedure, plan = load(good), registry.find("sphere.plan")
    inputs = inputs_of(procedure, procedure.steps[0], plan, {"touches_fit": 12, "order": "random"})
    result = plan.dump_result(asyncio.run(plan(None, inputs)))
    assert result["touches"] == [{"joints": [0.0], "name": "of 12"}]


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from(["${a}", "${plan.x[0]}", "${", "sphere.plan", "a", *WORDS]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(WORDS) | st.text(max_size=3), inner, max_size=4)
    ),
    max_leaves=20,
)


@given(values)
def test_no_file_crashes_reading_or_check(data):
    try:
        document = parse_yaml(yaml.safe_dump(data, allow_unicode=True), "p.yaml")
    except InputError:
        return
    procedure = read_procedure(document)
    problems = check(procedure, {}, StepRegistry(), {})
    assert procedure.name or problems
    assert all(problem.line >= 1 and problem.what for problem in problems)


def test_the_campaigns_that_come_with_the_program_load():
    for path in sorted((Path(__file__).parents[2] / "procedures").glob("*.yaml")):
        assert load_procedure(path).problems == ()
