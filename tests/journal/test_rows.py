"""Rows as classes: what is recorded is read again, older journals too, and a damaged row names what is wrong in it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.journal import (
    Entry,
    Journal,
    PushedTable,
    Recorded,
    RunEnded,
    RunResult,
    RunStarted,
    SourceFile,
    fold,
    read_journal,
)
from cellctl.records import ArtefactRow, BadRow, Row, TablePushRow, TableStateRow, VerdictRow
from procedures.steps.sphere.rows import LocateRow, SphereVerdict, TouchRow
from tests.helpers.steps import reference, sphere_verdict, standoff, touch

TABLE = TableStateRow("ab" * 32, 30, True, True, True, 0.1)
ROWS = [
    touch(number=3),
    LocateRow(**touch(set="locate").data()),
    reference(0.03, 0.02),
    standoff(number=1, run="after", row=2, error_mm=0.1, expected_mm=0.0, sigma_mm=0.03),
    TABLE,
    TablePushRow("ab" * 32, 30, False, False, None, 0.1),
    ArtefactRow("model.json", "0" * 64, 12),
    sphere_verdict(table=TABLE),
]


@dataclass(frozen=True)
class PointRow(Row):
    """A row of a campaign that this program does not bring."""

    KIND: ClassVar[str] = "point"
    VERSION: ClassVar[int] = 2
    MEASUREMENT: ClassVar[bool] = True
    xyz: tuple[float, float, float]
    name: str = ""
    tags: tuple[str, ...] = field(default=())

    @classmethod
    def of_older(cls, data: Mapping[str, Any], version: int) -> Mapping[str, Any]:
        return data if version >= 2 else {**data, "xyz": [data["x"], data["y"], data["z"]]}


def journal_of(*events: Any) -> Any:
    return fold(Entry(seq, seq, event) for seq, event in enumerate(events, 1))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.KIND)
def test_a_row_is_the_same_row_when_it_is_read_from_the_file(row: Row, tmp_path) -> None:
    with Journal.create(tmp_path / "run", lambda: 0) as journal:
        journal.append(Recorded.of(row))
    assert fold(read_journal(tmp_path / "run")).recorded(type(row)) == [row]


numbers = st.floats(allow_nan=False, allow_infinity=False)


@given(st.builds(PointRow, st.tuples(numbers, numbers, numbers), st.text(), st.lists(st.text()).map(tuple)))
def test_any_row_that_json_can_hold_is_read_as_it_was_written(row: PointRow) -> None:
    assert PointRow.read(row.data(), 2) == row


def test_an_older_version_is_read_by_its_class_and_a_newer_one_is_refused() -> None:
    assert PointRow.read({"x": 1.0, "y": 2.0, "z": 3.0}, 1) == PointRow((1.0, 2.0, 3.0))
    with pytest.raises(BadRow, match="version 3, and this program reads versions up to 2"):
        PointRow.read({"xyz": [1.0, 2.0, 3.0]}, 3)


def test_fields_of_a_newer_program_are_passed_over() -> None:
    assert PointRow.read({"xyz": [1, 2, 3], "humidity": 0.4}, 2) == PointRow((1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({}, "field 'xyz' is missing"),
        ({"xyz": [1.0, "2", 3.0]}, r"field 'xyz\.1' holds '2', which is of another type"),
        ({"xyz": [1.0, 2.0, 3.0], "name": 7}, "field 'name' holds '7'"),
    ],
)
def test_a_damaged_row_names_event_kind_and_field_in_our_own_words(data: dict[str, Any], words: str) -> None:
    journal = journal_of(Recorded("point", {"xyz": [0, 0, 0]}, version=2), Recorded("point", data, version=2))
    with pytest.raises(InputError, match=rf"event 2, a row of kind 'point': .*{words}") as refused:
        journal.recorded(PointRow)
    assert "pydantic" not in str(refused.value)


def test_rows_that_measure_count_as_points_whoever_brings_them() -> None:
    assert journal_of(Recorded.of(PointRow((0.0, 0.0, 0.0))), *map(Recorded.of, ROWS)).measurements == 2


def test_a_journal_from_before_rows_described_themselves_still_counts_its_touches() -> None:
    old = [Recorded("touch", {"number": 1}), Recorded("locate", {}), Recorded("verdict", {}), Recorded("touch", {})]
    assert journal_of(*old).measurements == 2


def started(**fields: Any) -> RunStarted:
    source = SourceFile("x.yaml", "", "")
    return RunStarted(source, source, {}, 1, "lockstep", "", "2026-11-21T20:30:02Z", "", {}, **fields)


def test_a_result_has_the_section_of_its_campaign_and_no_other() -> None:
    row = sphere_verdict(lines=("Stops: few.",))
    state = journal_of(started(section=SphereVerdict.SECTION), Recorded.of(touch()), Recorded.of(row))
    result = RunResult.of("run", state, wall_s=1.0)
    assert (result.verdict, result.points, result.lines) == ("better", 1, ("Stops: few.",))
    content = result.to_json()
    assert content["drift"] == row.data()["drift"]
    assert content["before"] == {"mean": 0.7, "rms": 0.9, "max": 2.0}
    other = journal_of(
        started(section=("angles",)), Recorded("verdict", {**VerdictRow("better", "").data(), "angles": 3})
    )
    assert RunResult.of("run", other).section == {"angles": 3}


def test_a_result_without_a_verdict_shows_the_section_empty() -> None:
    for began in (started(section=SphereVerdict.SECTION), started()):  # the second one: a journal from before
        content = RunResult.of("run", journal_of(began)).to_json()
        assert [content[name] for name in ("held_out", "standoff", "drift", "stops", "verdict")] == [None] * 5


def test_a_result_states_the_cells_time_from_the_first_event_to_the_last() -> None:
    began_ns, ended_ns = 2_000_000_000, 5_500_000_000
    state = fold([Entry(1, began_ns, started()), Entry(2, ended_ns, RunEnded("finished"))])
    assert RunResult.of("run", state).simulated_s == pytest.approx(3.5)


def test_a_row_that_the_engine_records_belongs_to_no_step_and_no_attempt() -> None:
    recorded = Recorded.of(PointRow((0.0, 0.0, 0.0)))
    assert (recorded.step, recorded.attempt) == ("", 0)


def test_the_table_of_a_run_is_proved_by_a_verdict_on_this_table_alone() -> None:
    another = sphere_verdict(table=TableStateRow("cd" * 32, 30, True, True, True, 0.1))
    for verdict, proved in ((sphere_verdict(table=TABLE), True), (another, False)):
        table = PushedTable.of(journal_of(Recorded.of(TABLE), Recorded.of(verdict)))
        assert table is not None
        assert table.proved is proved


def test_a_touch_row_is_no_row_of_another_kind_with_the_same_fields() -> None:
    state = journal_of(Recorded.of(ROWS[1]))
    assert state.recorded(TouchRow) == []
    assert state.recorded(LocateRow) == [ROWS[1]]
