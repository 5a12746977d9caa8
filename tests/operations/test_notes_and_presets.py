"""Notes on a run and presets of its start: kept with person and time, whole after a crash."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.engine import Operator
from cellctl.files import InputError
from cellctl.operations.presets import delete_preset, keep_preset, presets_of
from cellctl.operations.run_notes import FILE_NAME, LONGEST, add_note, notes_of

ADA = Operator("Ada", "cell-pc", "console")


def test_notes_are_in_their_order_with_person_and_text_also_after_a_line_that_was_cut_off(tmp_path: Path) -> None:
    add_note(tmp_path, ADA, " probe changed\nafter touch 20 ")
    with (tmp_path / FILE_NAME).open("a") as file:
        file.write('{"time": "20')
    add_note(tmp_path, ADA, "warm")
    assert [(each.operator, each.host, each.text) for each in notes_of(tmp_path)] == [
        ("Ada", "cell-pc", "probe changed\nafter touch 20"),
        ("Ada", "cell-pc", "warm"),
    ]


@pytest.mark.parametrize("text", ["", "  ", "x" * (LONGEST + 1)])
def test_an_empty_or_too_long_note_is_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        add_note(tmp_path, ADA, text)
    assert notes_of(tmp_path) == []


def test_a_preset_is_kept_replaced_and_deleted_by_its_name(tmp_path: Path) -> None:
    keep_preset(tmp_path, "daily_check", "night  shift", {"points": "12"}, "Ada")
    keep_preset(tmp_path, "daily_check", "short", {"points": "5"}, "Kim")
    keep_preset(tmp_path, "daily_check", "short", {"points": "6"}, "Kim")
    found = presets_of(tmp_path, "daily_check")
    assert {name: (each.settings, each.operator) for name, each in found.items()} == {
        "night shift": ({"points": "12"}, "Ada"),
        "short": ({"points": "6"}, "Kim"),
    }
    delete_preset(tmp_path, "daily_check", "night shift")
    assert list(presets_of(tmp_path, "daily_check")) == ["short"]
    assert presets_of(tmp_path, "iso9283") == {}


def test_a_preset_without_a_name_and_a_damaged_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no name"):
        keep_preset(tmp_path, "daily_check", " ", {}, "Ada")
    (tmp_path / "presets").mkdir()
    (tmp_path / "presets" / "daily_check.json").write_text("{")
    with pytest.raises(InputError, match="holds no presets"):
        presets_of(tmp_path, "daily_check")
