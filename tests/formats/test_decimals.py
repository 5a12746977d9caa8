"""Numbers as people write them: read as meant, or refused where two meanings are possible; never another number."""

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.formats.spreadsheet_text import decimal_sign, number

SIGNS = {"point": ".", "comma": ","}
GROUPS = {"point": ["", ",", "'", " ", "\u00a0"], "comma": ["", ".", "'", " ", "\u202f"]}
MILLIS = st.integers(-9_999_999_999, 9_999_999_999)


def written(millis, sign, group, places=3):
    """Thousandths as a person writes them, without Python's own formatting of numbers."""
    whole, part = divmod(abs(millis), 1000)
    digits = str(whole)
    groups = []
    while len(digits) > 3:
        digits, last = digits[:-3], digits[-3:]
        groups.insert(0, last)
    text = group.join([digits, *groups])
    fraction = f"{part:03d}"[:places]
    return ("-" if millis < 0 else "") + text + (SIGNS[sign] + fraction if places else "")


@given(MILLIS, st.sampled_from(["point", "comma"]), st.data())
def test_a_number_in_every_style_is_read_exactly(millis, sign, data):
    group = data.draw(st.sampled_from(GROUPS[sign]))
    assert number(written(millis, sign, group), sign) == Decimal(millis) / 1000


@given(st.lists(MILLIS, min_size=1, max_size=20), st.sampled_from(["point", "comma"]), st.data())
def test_a_table_is_read_as_it_was_meant_or_refused_but_never_otherwise(values, sign, data):
    group = data.draw(st.sampled_from(GROUPS[sign]))
    texts = [written(value, sign, group) for value in values]
    cells = list(enumerate(texts, 2))
    try:
        found, _ = decimal_sign("p.csv", cells, None)
    except InputError:
        found, _ = decimal_sign("p.csv", cells, sign)
    assert [number(text, found) for text in texts] == [Decimal(value) / 1000 for value in values]


@pytest.mark.parametrize("text", ["1,234", "1.234", "-12,345", "+999.000"])
def test_what_could_be_thousands_or_decimals_is_refused_with_both_readings(text):
    with pytest.raises(InputError) as refused:
        decimal_sign("p.csv", [(7, text), (8, "12")], None)
    (problem,) = refused.value.problems
    assert problem.line == 7
    assert "--decimal point" in problem.cure
    assert "--decimal comma" in problem.cure


@pytest.mark.parametrize(
    ("texts", "sign"),
    [
        (["1,5"], "comma"),
        (["1234,567"], "comma"),
        (["0,123"], "comma"),
        (["1.234,5"], "comma"),
        (["1.234.567"], "comma"),
        (["1,234,567"], "point"),
        (["1'234.567"], "point"),
        (["1.5e-3"], "point"),
        (["1,234E2"], "comma"),
        (["1,234", "5,67"], "comma"),
        (["1.234", "5.678,9"], "comma"),
        (["12", "-3"], "point"),
    ],
)
def test_one_number_that_can_be_read_in_one_way_only_decides(texts, sign):
    assert decimal_sign("p.csv", list(enumerate(texts, 1)), None)[0] == sign


def test_a_dot_that_would_be_thousands_beside_decimal_commas_is_refused_until_the_user_says_so():
    cells = [(2, "1.234"), (3, "567,8")]
    with pytest.raises(InputError, match="beside '567,8' on line 3"):
        decimal_sign("p.csv", cells, None)
    assert decimal_sign("p.csv", cells, "comma")[0] == "comma"


def test_both_decimal_signs_in_one_table_are_named_with_their_lines():
    with pytest.raises(InputError, match=r"'1,5' has a decimal comma, '2\.5' on line 3 a decimal point"):
        decimal_sign("p.csv", [(2, "1,5"), (3, "2.5")], None)


def test_numbers_that_are_certain_are_not_overruled():
    sign, said = decimal_sign("p.csv", [(2, "0.5")], "comma")
    assert sign == "point"
    assert "whatever --decimal comma says" in said


@pytest.mark.parametrize(
    "text", ["", "-", "1,2,3", "1.23.456", "12,34.5", "1_000", "nan", "inf", "١٢", "1 23", "0x1f", "1e", "--1"]
)
def test_what_is_no_number_stays_none(text):
    assert number(text, "point") is None
    assert number(text, "comma") is None
