"""YAML that means what it says, and errors that say where they stand."""

from __future__ import annotations

import json
import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import Document, InputError, Problem, load_yaml, parse_yaml


def refused(text: str) -> list[Problem]:
    with pytest.raises(InputError) as caught:
        parse_yaml(text, "cell.yaml")
    return caught.value.problems


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("on", "on"),
        ("off", "off"),
        ("yes", "yes"),
        ("No", "No"),
        ("y", "y"),
        ("true", True),
        ("False", False),
        ("tRUE", "tRUE"),
        ("~", None),
        ("null", None),
        ("", None),
        ("12", 12),
        ("-3", -3),
        ("+3", 3),
        ("007", 7),
        ("0o17", 15),
        ("0x1F", 31),
        ("1_000", "1_000"),
        ("12:30", "12:30"),
        ("2026-11-21", "2026-11-21"),
        ("1.5", 1.5),
        (".5", 0.5),
        ("5.", 5.0),
        ("1e3", 1000.0),
        ("-1.5E-3", -0.0015),
        ("1.e3", 1000.0),
        (".inf", math.inf),
        ("-.Inf", -math.inf),
        ("1.5mm", "1.5mm"),
        ("'12'", "12"),
        ('"true"', "true"),
        ("<<", "<<"),
    ],
)
def test_an_unquoted_word_is_what_yaml_1_2_says(written, meant):
    found = parse_yaml(f"a: {written}\n", "f").data["a"]
    assert (found, type(found)) == (meant, type(meant))


def test_not_a_number_is_read():
    assert math.isnan(parse_yaml("a: .nan", "f").data["a"])


def test_a_block_of_text_is_text():
    assert parse_yaml("a: |\n  12\n", "f").data == {"a": "12\n"}


def test_keys_are_words_whatever_they_look_like():
    assert parse_yaml("1: a\ntrue: b\n1.5: c\n", "f").data == {"1": "a", "true": "b", "1.5": "c"}


TEXT = """\
name: cell
limits:
  robot: {speed: 5, travel: 3}
steps:
  - move: 1
  - touch:
      at: [1, 2]
"""


@pytest.mark.parametrize(
    ("path", "value_at", "key_at"),
    [
        (("name",), (1, 7), (1, 1)),
        (("limits",), (3, 3), (2, 1)),
        (("limits", "robot"), (3, 10), (3, 3)),
        (("limits", "robot", "travel"), (3, 29), (3, 21)),
        (("steps", 0), (5, 5), None),
        (("steps", 1, "touch", "at", 1), (7, 15), None),
        (("steps", 1, "touch", "at"), (7, 11), (7, 7)),
    ],
)
def test_every_value_and_key_knows_its_place(path, value_at, key_at):
    document = parse_yaml(TEXT, "f")
    assert document.place(path) == value_at
    if key_at:
        assert document.place(path, key=True) == key_at


def test_what_is_missing_is_placed_at_its_nearest_parent():
    document = parse_yaml(TEXT, "f")
    assert document.place(("limits", "robot", "jerk")) == (3, 10)
    assert document.place(("limits", "robot", "jerk", "x"), key=True) == (3, 10)
    assert document.place(("nothing", "at", "all")) == (1, 1)
    assert str(document.problem(("limits", "robot"), "is odd", "change it")) == "f:3:10: is odd\n    change it"


def test_all_duplicate_keys_are_reported_at_once_each_with_the_first_ones_line():
    problems = refused("a: 1\nb: {c: 1, c: 2}\na: 3\na: 4\n")
    assert [(p.line, p.column) for p in problems] == [(2, 11), (3, 1), (4, 1)]
    assert all("line 1" in p.what for p in problems[1:])


def test_aliases_are_refused_where_they_stand():
    (problem,) = refused("a: &x 1\nb: *x\n")
    assert (problem.line, problem.column) == (2, 4)
    assert "*x" in problem.what


@pytest.mark.parametrize("text", ["a: &x [1, *x]\n", "? &k a\n: 1\nb: {*k : 2}\n", "a: &x {b: 1}\nc: {<<: *x}\n"])
def test_aliases_in_themselves_in_keys_and_in_merges_are_refused(text):
    assert "alias" in refused(text)[0].what


@pytest.mark.parametrize(
    ("text", "tag"), [("a: !!str 12\n", "!!str"), ("a: !!python/name:os.system\n", "!!"), ("!x\na: 1\n", "!x")]
)
def test_tags_are_refused(text, tag):
    assert tag in refused(text)[0].what


def test_tags_aliases_and_duplicates_do_not_hide_one_another():
    assert [p.line for p in refused("a: !!int 1\nb: !!int 2\nb: 3\n")] == [1, 2, 3]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a:\n\t- b\n", 2),
        ("a: 1\n b: 2\n", 2),
        ("a: [1, 2\nb: 3\n", 2),
        ("a: 'x\n", 1),  # where the quote is opened
        ("a: b: c\n", 1),
        ("a: 1\n---\nb: 2\n", 2),
        ("a: 1\nb: \x07\n", 2),
        ("{[1]: 2}\n", 1),
        ("a: *nothing\n", 1),
        ("a: " + "9" * 5000, 1),
        ("a: %x\n", 1),
    ],
)
def test_what_is_not_yaml_or_not_plain_is_refused_with_its_line(text, line):
    problem = refused(text)[0]
    assert (problem.file, problem.line) == ("cell.yaml", line)
    assert "\n" not in problem.what


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("a:\n\t- b\n", "a tab stands where only spaces can"),
        ("a: 1\n b: 2\n", "a second ': ' in one line, or a line indented too far"),
        ("a: b: c\n", "a second ': ' in one line, or a line indented too far"),
        ("a: 'x\n", "a quote is opened and not closed"),
        ("a: [1, 2\nb: 3\n", "a list in [ ] is not closed, or misses a comma (it begins on line 1)"),
        ("a: {b: 1\nc: 3\n", "a mapping in { } is not closed, or misses a comma (it begins on line 1)"),
        ("a: 1\n---\nb: 2\n", "a second document begins here (---)"),
        ("a: @x\n", "a value cannot begin with '@'"),
        ('a: "\\k"\n', "a backslash before a letter that has none"),
        ("a: 1\nb\nc: 2\n", "a key without its colon"),
        ("a: - b\n", "a list item ('- ') cannot stand here"),
        ("- a\nb: 1\n", "this line does not belong to the lines before it"),
        ("a: [,]\n", "a value is missing here"),
        ("a: &\n", "'*' and '&' have a meaning of their own"),
    ],
)
def test_what_is_not_yaml_is_reported_in_our_words_with_a_cure(text, what):
    (problem,) = refused(text)
    assert problem.what == what
    assert problem.cure


def test_nesting_without_end_is_an_error_not_a_crash():
    assert "nested" in refused("[" * 5000)[0].what


@pytest.mark.long
@given(st.text(max_size=60))
def test_any_text_is_read_or_refused_and_nothing_else(text):
    with suppress(InputError):
        assert isinstance(parse_yaml(text, "f"), Document)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.text("ab :#'\"-éß,[]{}&*!|>%@`", max_size=6),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abc", min_size=1), inner, max_size=3),
        max_leaves=12,
    )
)
def test_json_is_read_as_what_it_says(value):
    """JSON is YAML 1.2; Python's own writer is the judge."""
    assert parse_yaml(json.dumps(value, ensure_ascii=False), "f").data == value


def test_an_empty_file_holds_nothing(tmp_path):
    (tmp_path / "f.yaml").write_text("# only a comment\n")
    assert load_yaml(tmp_path / "f.yaml").data is None


def test_a_byte_order_mark_is_no_part_of_the_first_key(tmp_path):
    (tmp_path / "f.yaml").write_bytes(b"\xef\xbb\xbfa: 1\n")
    document = load_yaml(tmp_path / "f.yaml")
    assert document.data == {"a": 1}
    assert document.place(("a",), key=True) == (1, 1)


def test_a_file_in_another_encoding_is_refused_with_the_byte(tmp_path):
    (tmp_path / "f.yaml").write_bytes("a: Größe\n".encode("latin-1"))
    with pytest.raises(InputError, match=r"UTF-8.*byte 5"):
        load_yaml(tmp_path / "f.yaml")


def test_a_missing_file_and_a_folder_are_refused_by_name(tmp_path):
    for path in (tmp_path / "nothing.yaml", tmp_path):
        with pytest.raises(InputError, match="cannot be read") as caught:
            load_yaml(path)
        assert caught.value.problems[0].file == str(path)
