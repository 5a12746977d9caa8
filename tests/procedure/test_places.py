"""Where a step of a run is in its procedure, and what it could refer to."""

import pytest

from cellctl.files import parse_yaml
from cellctl.procedure import read_procedure
from cellctl.procedure.model import step_at

PROCEDURE = read_procedure(
    parse_yaml(
        """
procedure: places
title: Places
cell: cell.yaml
parameters:
  many: {type: integer, default: 2}
steps:
  - {id: first, do: own.first}
  - id: outer
    for_each: ${first.rows}
    as: row
    steps:
      - {id: second, do: own.second}
      - id: inner
        for_each: ${row.points}
        as: point
        steps:
          - {id: third, do: own.third}
  - id: enough
    if: ${many} > 1
    then:
      - {id: most, do: own.yes}
    else:
      - {id: most, do: own.no}
cleanup:
  - {id: hold, do: own.hold}
""",
        "places.yaml",
    )
)
FINISHED = {
    "first": {"rows": [{"points": [1, 2]}, {"points": [3, 4]}]},
    "outer[0].second": {"value": 5},
    "outer[1].second": {"value": 6},
    "enough": {"value": False},
}


def place(path):
    return step_at(PROCEDURE, path, {"many": 2}, FINISHED)


def test_a_step_in_loops_knows_their_variables_and_the_steps_before_it():
    step, scope = place("outer[1].inner[0].third")
    assert step.do == "own.third"
    assert scope == {
        "many": 2,
        "first": FINISHED["first"],
        "row": {"points": [3, 4]},
        "second": {"value": 6},
        "point": 3,
    }


def test_a_step_does_not_know_what_comes_after_it():
    assert place("first")[1] == {"many": 2}


def test_of_two_branches_the_one_is_meant_that_was_taken():
    assert place("enough.most")[0].do == "own.no"


def test_a_clean_up_step_knows_parameters_alone():
    step, scope = place("cleanup.hold")
    assert step.do == "own.hold"
    assert scope == {"many": 2}


@pytest.mark.parametrize("path", ["third", "outer[0]", "outer[0].nothing", "cleanup.first"])
def test_what_is_no_step_is_refused(path):
    with pytest.raises(LookupError):
        place(path)
