"""From YAML to a model: every error at once, each where it stands, with its cure."""

from __future__ import annotations

import pickle
from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from cellctl.files import InputError, Problem, parse_yaml
from cellctl.files.validated import validated


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Limits(Strict):
    speed: float = Field(gt=0)
    travel: float = 5


class Line(Strict):
    kind: Literal["line"]
    length: float


class Point(Strict):
    kind: Literal["point"]
    at: tuple[float, float, float]


class Cell(Strict):
    name: str
    limits: Limits
    count: int = 1
    moves: list[Annotated[Line | Point, Field(discriminator="kind")]] = []
    size: float | Limits = 1
    tip: float = 0.6

    @field_validator("tip")
    @classmethod
    def _thin(cls, value: float) -> float:
        if value > 3:
            raise ValueError("no tip is thicker than 3 mm")
        return value

    @model_validator(mode="after")
    def _named(self) -> Cell:
        if self.name == "nobody":
            raise ValueError("a cell needs a name of its own")
        return self


def problems_in(text: str, at=()) -> list[Problem]:
    with pytest.raises(InputError) as caught:
        validated(parse_yaml(text, "cell.yaml"), Cell, at)
    return caught.value.problems


GOOD = "name: a\nlimits: {speed: 1}\n"


def test_what_is_right_becomes_the_model():
    cell = validated(parse_yaml(GOOD + "moves:\n  - {kind: point, at: [1, 2, 3]}\n", "f"), Cell)
    assert cell.moves == [Point(kind="point", at=(1, 2, 3))]


def test_a_part_of_a_document_is_validated_and_placed_in_the_whole():
    text = "cells:\n  - name: a\n    limits: {speed: 1}\n  - name: b\n    limits: {speed: 0}\n"
    document = parse_yaml(text, "f")
    assert validated(document, Cell, ("cells", 0)).name == "a"
    with pytest.raises(InputError) as caught:
        validated(document, Cell, ("cells", 1))
    assert (caught.value.problems[0].line, caught.value.problems[0].column) == (5, 21)


def test_all_errors_come_at_once_in_the_order_of_the_file():
    problems = problems_in("limits: {sped: 1, travel: fast}\ncount: many\nmoves:\n  - {kind: line}\ntip: 4\n")
    assert [(p.line, p.column) for p in problems] == [(1, 1), (1, 9), (1, 10), (1, 27), (2, 8), (4, 5), (5, 6)]


@pytest.mark.parametrize(
    ("text", "place", "what", "cure"),
    [
        (GOOD + "lmits: 1\n", (3, 1), "'lmits' is not known here", "did you mean 'limits'?"),
        (GOOD + "zzz: 1\n", (3, 1), "'zzz' is not known here", "remove it"),
        ("name: a\nlimits:\n  speed: 1\n  travl: 2\n", (4, 3), "'travl' is not known here", "did you mean 'travel'?"),
        ("name: a\nlimits:\n  travel: 2\n", (3, 3), "'speed' is missing", "add 'speed:'"),
        ("name: a\nlimits: {speed: -1}\n", (2, 17), "limits.speed: has to be above 0 (here: -1)", ""),
        (GOOD + "count: 1.5\n", (3, 8), "count: has to be a whole number", ""),
        (GOOD + "moves: [{kind: point, at: [1, x, 3]}]\n", (3, 31), "moves.0.at.1: ", ""),
        (GOOD + "moves: [{kind: circle}]\n", (3, 9), "moves.0: 'circle' is not known, only 'line', 'point'", ""),
        (GOOD + "moves: [{kind: line, length: 1, width: 2}]\n", (3, 33), "'width' is not known here", "remove it"),
        (GOOD + "size: large\n", (3, 7), "size: ", ""),
        (GOOD + "tip: 4\n", (3, 6), "tip: no tip is thicker than 3 mm", ""),
        ("name: nobody\nlimits: {speed: 1}\n", (1, 1), "a cell needs a name of its own", ""),
        ("- 1\n- 2\n", (1, 1), "the file: ", ""),
    ],
)
def test_an_error_is_reported_in_words_where_it_stands(text, place, what, cure):
    problem = problems_in(text)[0]
    assert (problem.line, problem.column) == place
    assert what in problem.what
    assert problem.cure == cure


def test_a_long_wrong_value_is_shown_by_its_beginning():
    (problem,) = problems_in(f"{'1,2,3 ' * 1000}\n")
    assert "(here: '1,2,3 1,2,3" in problem.what
    assert len(problem.what) < 150


def test_an_empty_file_is_reported_to_be_empty():
    (problem,) = problems_in("# nothing yet\n")
    assert "empty" in problem.what


@pytest.mark.parametrize("at", [("cells",), ("name", "x"), ("moves", 3)])
def test_a_part_that_is_not_there_is_an_error_with_a_place(at):
    (problem,) = problems_in("name: a\nmoves: []\n", at)
    assert "missing" in problem.what
    assert problem.line > 0


def test_problems_are_sorted_by_file_and_place_and_shown_as_compilers_do():
    late, early, other = Problem("b", 9, 1, "late"), Problem("b", 2, 5, "early", "cure it"), Problem("a", 3, 0, "other")
    error = InputError([late, early, other])
    assert error.problems == [other, early, late]
    assert str(error) == "a:3: other\nb:2:5: early\n    cure it\nb:9:1: late"
    assert str(InputError(Problem("c", 0, 0, "whole file"))) == "c: whole file"


def test_an_input_error_survives_the_way_between_processes():
    error = InputError([Problem("a", 1, 2, "wrong", "right it")])
    assert pickle.loads(pickle.dumps(error)).problems == error.problems
