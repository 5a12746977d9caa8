"""URScript files: read without loss, whatever they hold; a line that is not understood does not stop the rest."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.files.spans import Span
from cellctl.urscript import (
    Assignment,
    Branches,
    Call,
    Elements,
    Evaluation,
    Function,
    Loop,
    Number,
    ScriptFile,
    Unknown,
    every,
    within,
)

PROGRAM = b"""\xef\xbb\xbf# Gr\xc3\xbc\xc3\x9fe\r
def part():\r
  set_tcp(p[0.0, 0, .1, 0, 0, 0])\r
  global P1 = p[.1, -.2, 3e-1, d2r(90), 0, 0]   # taught
  $ 3 "MoveJ"
  while (True):
    movej(get_inverse_kin(P1, qnear=[0, -1.5, 2, -1, -1.57, 0]), a=1.4, v=1)
    movel(pose_trans(F, p[1, 2,
       3, 4, 5, 6]), 1.2, r=0.01) # over two lines
    if x == 3 and not y:
      P[1] = 4
    elif z > 0x10:
      this is no statement
    else:
      run t()
    end
  end
end
"""


def file(text: bytes) -> ScriptFile:
    return ScriptFile("part.script", text)


def test_blocks_calls_lists_and_comments_are_read_with_their_lines() -> None:
    (main,) = file(PROGRAM).statements
    assert isinstance(main, Function)
    assert (main.name, main.kind, main.line) == ("part", "def", 2)
    kinds = [type(each) for each in main.body]
    assert kinds == [Evaluation, Assignment, Loop]
    loop = main.body[2]
    assert isinstance(loop, Loop)
    assert [(type(each), each.line) for each in loop.body] == [(Evaluation, 7), (Evaluation, 8), (Branches, 10)]
    branches = loop.body[2]
    assert isinstance(branches, Branches)
    assert branches.has_else
    first, second, third = (body[0] for body in branches.bodies)
    assert isinstance(first, Assignment)
    assert first.element
    assert isinstance(second, Unknown)
    assert second.line == 13
    assert isinstance(third, Evaluation)
    assert third.starts_thread


def test_places_are_those_of_the_bytes_and_a_changed_number_changes_nothing_else() -> None:
    read = file(PROGRAM)
    poses = [each for each in every(read.statements) if isinstance(each, Assignment) and each.name == "P1"]
    value = poses[0].value
    assert isinstance(value, Elements)
    assert value.is_pose
    numbers = [each for each in value.items if isinstance(each, Number)]
    assert [read.source(each.span) for each in numbers] == [".1", "-.2", "3e-1", "0", "0"]
    assert [each.value for each in numbers] == [0.1, -0.2, 0.3, 0.0, 0.0]
    assert read.replaced({numbers[1].span: "-0.25"}) == PROGRAM.replace(b"-.2,", b"-0.25,")
    assert read.replaced({}) == PROGRAM


def test_a_call_over_several_lines_has_its_named_arguments() -> None:
    calls = [
        inner
        for each in every(file(PROGRAM).statements)
        if isinstance(each, Evaluation)
        for inner in within(each.value)
        if isinstance(inner, Call) and inner.name == "movel"
    ]
    radius = calls[0].argument(4, "r")
    assert isinstance(radius, Number)
    assert radius.value == 0.01
    assert calls[0].argument(2, "v") is None


def test_a_variable_has_a_value_only_where_it_is_assigned_once() -> None:
    text = b"a = 1\nb = 1\nb = 2\nc = [1]\nc[0] = 2\ndef f(d):\n d = 1\nend\ne = 5\ne !! 3\n"
    values = file(text).values
    assert isinstance(values["a"], Number)
    assert [values[name] for name in "bcde"] == [None] * 4


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [(b"def a():\n movej([1])\n", 1, "without an end"), (b"x = 1\nend\n", 2, "was not begun")],
)
def test_blocks_that_do_not_match_are_refused_with_their_line(text: bytes, line: int, words: str) -> None:
    with pytest.raises(InputError, match=words) as refused:
        _ = file(text).statements
    assert refused.value.problems[0].line == line


WORDS = [
    "def f():",
    "end",
    "while x:",
    "if a:",
    "elif b:",
    "else:",
    "movel(p[1,2,3,4,5,6])",
    "x = [",
    "]",
    "p[",
    "run",
    ")",
]


@given(st.lists(st.sampled_from(WORDS) | st.text(max_size=8), max_size=20).map("\n".join))
def test_any_text_is_read_or_refused_and_comes_back_unchanged(text: str) -> None:
    data = text.encode("utf-8", "surrogatepass")
    read = file(data)
    assert read.replaced({}) == data
    try:
        found = list(every(read.statements))
    except InputError:
        return
    for each in found:
        if isinstance(each, Evaluation | Assignment):
            assert Span(0, 0) <= each.span <= Span(len(data), len(data))
