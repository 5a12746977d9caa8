"""`if`, `confirm` and `interlocks` in a procedure file: what they mean, and every error in them before the run."""

import pytest

from cellctl.procedure import Confirm, Expression, If, Interlock, OnBreak, Resume, Step, UnresolvedReference, check

BRANCHES = """\
procedure: branches
title: Branches
cell: cell.yaml
parameters:
  quick: {type: flag, default: false}
  touches: {type: integer, default: 20}
  order: {type: text, default: random}
interlocks:
  - {id: whole, device: probe, condition: whole, resume: auto}
  - {id: ready, device: robot, condition: ready, on_break: abort}
steps:
  - {id: clear, confirm: "Is the cell clear?", timeout: 600}
  - id: short
    if: ${quick}
    then:
      - {id: plan, do: sphere.plan, with: {fit: 10}}
    else:
      - {id: plan_all, do: sphere.plan, with: {fit: "${touches}"}}
"""

CONDITIONS = {"probe": {"whole": "the loop is whole"}, "robot": {"ready": "the drives are ready"}}
DEVICES = {"robot": None, "probe": None}


@pytest.fixture
def found(load, registry):
    def find(text: str) -> list[str]:
        procedure = load(text)
        values = {name: parameter.default for name, parameter in procedure.parameters.items()}
        return [
            str(problem).removeprefix("procedures/p.yaml:")
            for problem in check(procedure, values, registry, DEVICES, CONDITIONS)
        ]

    return find


def test_branches_confirmations_and_interlocks_are_read(load, found):
    procedure = load(BRANCHES)
    confirm, branch = procedure.steps
    assert found(BRANCHES) == []
    assert isinstance(confirm, Confirm)
    assert (confirm.text, confirm.timeout_s) == ("Is the cell clear?", 600.0)
    assert isinstance(branch, If)
    assert isinstance(branch.then[0], Step)
    assert [action.id for action in procedure.actions()] == ["clear", "short", "plan", "plan_all"]
    assert procedure.interlocks == (
        Interlock("whole", "probe", "whole", OnBreak.STOP, Resume.AUTO, ("interlocks", 0)),
        Interlock("ready", "robot", "ready", OnBreak.ABORT, Resume.OPERATOR, ("interlocks", 1)),
    )


@pytest.mark.parametrize(
    ("right", "wrong", "expected"),
    [
        ("${quick}", "${touches}", "${touches} is a number, and has to be a flag here"),
        ("${quick}", "${touches} > many", "many is no literal"),
        ("${quick}", "${order} > 'a'", "'>' compares numbers"),
        ("${quick}", "${order} == 3", "${order} is text, and has to be a number here"),
        ("${quick}", "${quik}", "nothing here is called 'quik'"),
        ("${quick}", "${quick} and ${quick}", "is no expression"),
        ("    then:\n", "    than:\n", "'than' is not known in an 'if'"),
        ("else:\n", "else: []\n    x:\n", "there is no step here"),
        ("condition: whole", "condition: hole", "'probe' has no condition 'hole'\n    did you mean 'whole'?"),
        ("condition: whole", "condition: door", "choose one; its conditions: "),
        ('"Is the cell clear?"', '""', "the text of a 'confirm' is empty"),
        ("device: probe", "device: prob", "the cell has no device 'prob'\n    did you mean 'probe'?"),
        ("on_break: abort", "on_break: abort, resume: auto", "an interlock that aborts the run has nothing to resume"),
        ("on_break: abort", "on_break: halt", "'on_break' of an interlock is not usable (here: 'halt')"),
        ("id: ready", "id: whole", "'whole' names two interlocks"),
        ('"Is the cell clear?"', '"Is ${order} clear?"', "the text of a 'confirm' has no references"),
        ("  - {id: clear", "  - {id: plan", "'plan' names two steps"),
        ("{fit: 10}", '{fit: "${clear}"}', "'clear' is no step and has no result"),
        ("steps:\n", "cleanup:\n  - {id: c, confirm: Done}\nsteps:\n", "clean-up has no loops, no 'if' and no"),
    ],
)
def test_each_error_is_named(found, right, wrong, expected):
    text = BRANCHES.replace(right, wrong, 1)
    assert text != BRANCHES
    assert expected in "\n".join(found(text))


def test_a_result_inside_a_branch_is_not_known_outside_it(found):
    after = '  - {id: later, do: sphere.plan, with: {fit: "${plan.seconds}"}}\n'
    assert "stays inside its loop or 'if'" in "\n".join(found(BRANCHES + after))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("${quick}", False),
        ("not ${quick}", True),
        ("${n} > 3", True),
        ("${n}<=3.5", False),
        ("${n} != 4", False),
        ("${order} == 'random'", True),
        ('${order} != "random"', False),
        ("${quick} == false", True),
        ("${plan.n[1]} >= 2", True),
    ],
)
def test_expressions_have_the_value_that_they_say(text, value):
    scope = {"quick": False, "n": 4, "order": "random", "plan": {"n": [1, 2]}}
    assert Expression.parse(text).value(scope) is value


def test_an_expression_that_the_run_cannot_decide_says_why():
    with pytest.raises(ValueError, match="has to be a flag"):
        Expression.parse("${n}").value({"n": 1})
    with pytest.raises(ValueError, match="neither flag, number nor text"):
        Expression.parse("${n} > 3").value({"n": None})
    with pytest.raises(UnresolvedReference):
        Expression.parse("${n}").value({})
