"""What a replay computes again, from what, and what it says where bytes differ; on small steps of the tests' own."""

from __future__ import annotations

import asyncio
import itertools
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from cellctl.cli.verbs import app
from cellctl.clock import WallClock
from cellctl.engine import Engine, Mailbox, Plan, Surround
from cellctl.files import InputError, load_yaml, sha256_of
from cellctl.journal import (
    Journal,
    JournalError,
    Recorded,
    RunStarted,
    RunState,
    SourceFile,
    check_journal,
    read_journal,
)
from cellctl.operations.launch import code_hash, sources, versions
from cellctl.operations.replay import Agreement, FolderFile, Replay, replay_run
from cellctl.operations.replay._run import same_within_tolerance
from cellctl.operations.results import as_json
from cellctl.procedure import (
    NoInputs,
    StepContext,
    StepInputs,
    StepRegistry,
    StepResult,
    load_procedure,
    step,
)
from cellctl.records import ComputingTimesRow, Row
from cellctl.report import report_text
from tests.helpers.engine import FakeDevice
from tests.helpers.runs import edited

CALLS: list[str] = []
EXTRA: dict[str, Any] = {"text": "", "value": 0}  # what the steps add to what they compute, to make a replay differ


@dataclass(frozen=True)
class ReadingRow(Row):
    KIND = "reading"
    value: float


class Numbers(StepResult):
    values: list[int]


class Value(StepInputs):
    value: int


class Sum(StepResult):
    value: float


@step("own.numbers")
async def numbers(context: StepContext, inputs: NoInputs) -> Numbers:
    """Give three numbers."""
    return Numbers(values=[1, 2, 3])


@step("own.measure", needs={"robot": FakeDevice}, moves=True)
async def measure(context: StepContext, inputs: Value) -> None:
    """Record a reading, by means of the robot."""
    CALLS.append(f"measured {inputs.value}")
    await context.record(ReadingRow(10 * inputs.value))


@step("own.total")
async def total(context: StepContext, inputs: NoInputs) -> Sum:
    """Add up what was measured so far; write all that a step may know into a file."""
    value = sum(row.value for row in context.recorded(ReadingRow)) + EXTRA["value"]
    who = context.identity("robot").serial
    lines = [context.step, who, context.calendar, context.run_name, context.seed, value]
    lines += [context.robot_file.read_text(), context.cell.data["name"]]
    await context.write_artefact("data.csv", "".join(f"{line}\n" for line in lines) + EXTRA["text"])
    await context.record(ReadingRow(-value))
    return Sum(value=value)


@step("own.copy")
async def copy(context: StepContext, inputs: NoInputs) -> None:
    """Make one file of another."""
    await context.write_artefact("copy.csv", (context.run_folder / "data.csv").read_text())


@step("own.refuse")
async def refuse(context: StepContext, inputs: NoInputs) -> None:
    """Refuse, with the paths of its files."""
    await context.write_artefact("data.csv", "what was refused\n")
    data = context.run_folder / "data.csv"
    raise ValueError(f"{data} contradicts {context.robot_file} and {context.cell.file}{EXTRA['text']}")


SECONDS = itertools.count(0.25)


@step("own.timed")
async def timed(context: StepContext, inputs: NoInputs) -> None:
    """Record how long something took: each time another number."""
    await context.record(ReadingRow(1.0))
    await context.record(ComputingTimesRow(what=("sum",), seconds=(next(SECONDS),), repeats=1))


REGISTRY = StepRegistry([numbers, measure, total, copy, refuse, timed])

STEPS = """
  - {id: some, do: own.numbers}
  - {id: before, do: own.total}
  - id: each
    for_each: ${some.values}
    as: number
    steps:
      - {id: measured, do: own.measure, with: {value: "${number}"}}
      - {id: so_far, do: own.total}
  - id: enough
    if: ${before.value} < 1
    then:
      - {id: whole, do: own.total}
      - {id: again, do: own.copy}
"""


@pytest.fixture(autouse=True)
def as_in_the_run():
    CALLS.clear()
    EXTRA.update(text="", value=0)


def run(folder: Path, steps: str = STEPS, **made: Any) -> Path:
    """Run a procedure of these steps in `folder`; its run folder. made: what its first event says otherwise."""
    texts = {
        "procedure.yaml": f"procedure: small\ntitle: small steps\ncell: cell.yaml\nsteps:{steps}",
        "cell.yaml": "name: a cell\nmodel: robot.yaml\n",
        "robot.yaml": "name: a robot\n",
    }
    folder.mkdir(exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text)
    files = [SourceFile(str(folder / name), text, sha256_of(text)) for name, text in texts.items()]
    event = RunStarted(
        *files[:2],
        {},
        7,
        "realtime",
        "me",
        "2026-11-21T00:00:00Z",
        code_hash(),
        versions(),
        files[2],
        sources(),
        "first",
    )
    asyncio.run(_carried_out(folder, replace(event, **made)))
    return folder / "run"


async def _carried_out(folder: Path, event: RunStarted) -> None:
    clock, devices = WallClock(), {"robot": FakeDevice("robot")}
    procedure = load_procedure(folder / "procedure.yaml")
    assert procedure.problems == ()
    surround = Surround(
        clock, event.seed, folder / "run", load_yaml(folder / "cell.yaml"), folder / "robot.yaml", devices
    )
    with Journal.create(folder / "run", clock.now_ns) as journal:
        state = RunState()
        state.apply(journal.append(event))
        await Engine(Plan(procedure, {}, REGISTRY, devices), surround, journal, Mailbox(), None, state).run()


def replayed(folder: Path) -> Replay:
    CALLS.clear()
    return replay_run(folder, registry=REGISTRY)


def file_of(found: Replay, step: str):
    return next(each for each in found.artefacts if each.step == step)


def test_every_computing_step_is_done_again_with_what_it_knew_then_and_no_device_is_asked(tmp_path):
    found = replayed(run(tmp_path))
    assert [each.step for each in found.steps] == [
        "some",
        "before",
        *(f"each[{index}].so_far" for index in range(3)),
        "enough.whole",
        "enough.again",
    ]
    assert found.agreement is Agreement.EXACT
    assert found.changed == ()
    assert len({each.replayed for each in found.artefacts}) == 5, "each saw other rows; the copy is that of the last"
    assert CALLS == []


def test_times_that_a_step_took_are_not_compared_and_its_other_rows_are(tmp_path):
    folder = run(tmp_path, "\n  - {id: timed, do: own.timed}\n")
    kinds = [entry.event.row_kind for entry in read_journal(folder) if isinstance(entry.event, Recorded)]
    assert kinds == ["reading", "computing times"]
    found = replayed(folder)
    assert found.agreement is Agreement.EXACT
    assert [each.rows for each in found.steps] == [1]


def test_a_run_is_replayed_from_its_journal_alone(tmp_path):
    folder = run(tmp_path / "first")
    alone = tmp_path / "elsewhere"
    alone.mkdir()
    shutil.copy(folder / "journal.sqlite", alone / "journal.sqlite")
    shutil.rmtree(tmp_path / "first")
    found = replayed(alone)
    assert found.agreement is Agreement.EXACT
    assert {each.folder for each in found.artefacts if each.step == "enough.again"} == {FolderFile.MISSING}
    assert [path.name for path in alone.iterdir()] == ["journal.sqlite"], "nothing was written there"


def test_files_written_again_later_are_compared_with_the_journal_alone(tmp_path):
    found = replayed(run(tmp_path))
    states = {each.step: each.folder for each in found.artefacts if each.name == "data.csv"}
    assert states.pop("enough.whole") is FolderFile.AS_RECORDED
    assert set(states.values()) == {FolderFile.REPLACED}


def test_a_file_that_was_edited_after_the_run_is_named_with_its_first_byte_and_the_replay_is_equal(tmp_path):
    folder = run(tmp_path)
    text = (folder / "copy.csv").read_text()
    (folder / "copy.csv").write_text(text.replace("SIM-1", "SIM-9"))
    found = replayed(folder)
    copied = file_of(found, "enough.again")
    assert copied.replayed_equal
    assert copied.agreement is Agreement.DIFFERENT
    assert found.agreement is Agreement.DIFFERENT
    assert copied.first is not None
    assert copied.first.byte == text.index("SIM-1") + 5
    assert copied.first.line == 2
    assert (copied.first.before, copied.first.now) == ("'-9'", "'-1'")
    assert copied.why == ("the file in the run folder was changed after the run",)


def test_a_changed_digit_of_a_measurement_is_noticed_by_replay_report_and_show(tmp_path, capsys):
    folder = run(tmp_path)
    digest = check_journal(folder).digest
    assert digest in report_text(folder)
    show = ["show", str(folder), "--verify"]
    assert app(show, standalone_mode=False) == 0
    assert digest in capsys.readouterr().out
    reading = next(
        e.seq for e in read_journal(folder) if isinstance(e.event, Recorded) and e.event.row_kind == "reading"
    )
    edited(folder / "journal.sqlite", f"UPDATE events SET data = replace(data, '0', '1') WHERE seq = {reading}")
    said = f"event {reading} is not as it was written"
    found = replayed(folder)
    assert (found.edited, found.agreement) == ((said,), Agreement.DIFFERENT)
    assert f"the journal was changed after the run: {said}" in report_text(folder)
    assert app(show, standalone_mode=False) == 1
    assert f"changed after the run: {said}" in capsys.readouterr().out


def test_other_bytes_are_named_with_their_place_and_a_step_that_nothing_explains(tmp_path):
    folder = run(tmp_path)
    EXTRA.update(text="more")
    whole = file_of(replayed(folder), "before")
    assert not whole.replayed_equal
    assert "does not compute the same twice" in whole.why[0]
    last = file_of(replayed(folder), "enough.whole")
    assert last.first is not None
    assert last.first.byte == len((folder / "data.csv").read_bytes()) + 1
    assert last.first.before == "the end of the file"


def test_what_is_made_of_a_file_that_differs_names_that_file(tmp_path):
    folder = run(tmp_path)
    EXTRA.update(text="more")
    assert file_of(replayed(folder), "enough.again").why == ("data.csv, made before it, differs as well",)


def test_results_and_rows_that_differ_are_named_key_by_key(tmp_path):
    folder = run(tmp_path)
    EXTRA.update(value=5)
    found = replayed(folder)
    before = next(each for each in found.steps if each.step == "before")
    assert before.differences == ("result.value: 0.0 → 5.0", "reading.value: 0 → -5")
    assert next(each for each in found.steps if each.step == "some").agreement is Agreement.EXACT


def test_the_reason_is_what_has_changed_since_the_run(tmp_path):
    older = {**versions(), "numpy": "2.3.1", "platform": "Linux-of-before"}
    gone = {**sources(), "procedures/gone.py": "0" * 64}
    folder = run(tmp_path, versions=older, code_sha256="0" * 64, sources=gone)
    assert replayed(folder).agreement is Agreement.EXACT, (
        "other versions are no difference as long as the bytes are equal"
    )
    EXTRA.update(text="more")
    found = replayed(folder)
    assert set(found.changed) == {
        f"numpy 2.3.1 → {versions()['numpy']}",
        f"platform Linux-of-before → {versions()['platform']}",
        "the code of cellctl, its drivers or steps has changed: procedures/gone.py",
    }
    assert file_of(found, "enough.whole").why[:3] == found.changed


def test_where_journal_folder_and_replay_all_differ_it_is_said_that_the_place_is_not_known(tmp_path):
    folder = run(tmp_path)
    (folder / "data.csv").write_text("edited")
    EXTRA.update(text="more")
    whole = file_of(replayed(folder), "enough.whole")
    assert whole.first is None
    assert whole.why[-2:] == (
        "the file in the run folder was changed after the run",
        "the run's own bytes are not in the run folder, so it cannot be said where they differ",
    )


REFUSING = "\n  - {id: no, do: own.refuse}\n"


def test_a_step_that_failed_fails_again_in_the_same_words_wherever_the_run_folder_is(tmp_path):
    folder = run(tmp_path / "first", REFUSING)
    (tmp_path / "moved").mkdir()
    moved = shutil.move(folder, tmp_path / "moved" / "run")
    assert replayed(Path(moved)).agreement is Agreement.EXACT
    EXTRA.update(text=", another text")
    (failed,) = replayed(Path(moved)).steps
    assert failed.differences[0].startswith("failure.text: ")


def test_a_step_that_was_cut_off_is_passed_over(tmp_path):
    folder = run(tmp_path)
    cut = tmp_path / "cut"
    entries = list(read_journal(folder))
    with Journal.create(cut, lambda: 0) as journal:
        for entry in entries:
            journal.append(entry.event)
            if getattr(entry.event, "step", "") == "each[1].so_far":
                break
    assert [each.step for each in replayed(cut).steps] == ["some", "before", "each[0].so_far"]


def test_a_journal_that_does_not_hold_its_sources_is_refused(tmp_path):
    folder = run(tmp_path, robot=None)
    with pytest.raises(InputError, match="did not keep all source files"):
        replayed(folder)


def test_where_there_is_no_run_the_call_is_refused(tmp_path):
    with pytest.raises(JournalError, match="there is no journal"):
        replayed(tmp_path / "nothing")


def test_a_step_that_is_not_installed_is_named(tmp_path):
    with pytest.raises(InputError, match=r"own\.numbers"):
        replay_run(run(tmp_path))


SMALLER_THAN_ANY_ROUNDING = 3e-13


@pytest.fixture
def elsewhere(tmp_path):
    """A run that another processor made; its copy of a file names that file's content by its hash."""
    return run(tmp_path, versions={**versions(), "BLAS": "openblas 0.3.30 Nehalem"})


def test_a_run_of_another_processor_is_equal_within_the_tolerance_though_no_byte_of_its_files_is(elsewhere):
    EXTRA.update(value=SMALLER_THAN_ANY_ROUNDING)
    found = replayed(elsewhere)
    assert found.agreement is Agreement.WITHIN_TOLERANCE
    assert file_of(found, "enough.again").agreement is Agreement.WITHIN_TOLERANCE
    assert not file_of(found, "enough.again").replayed_equal
    assert "BLAS openblas 0.3.30 Nehalem → " in found.changed[0]
    assert as_json(found)["agreement"] == "equal within the stated tolerance (other processor or library)"


def test_last_digits_that_no_other_processor_or_library_explains_are_not_equal(tmp_path):
    folder = run(tmp_path)
    EXTRA.update(value=SMALLER_THAN_ANY_ROUNDING)
    assert replayed(folder).agreement is Agreement.DIFFERENT


@pytest.mark.parametrize("extra", [{"value": 0.01}, {"text": "more"}, {"text": "0.1\n"}])
def test_what_another_processor_does_not_change_is_not_equal(elsewhere, extra):
    EXTRA.update(extra)
    assert replayed(elsewhere).agreement is Agreement.DIFFERENT


def test_a_changed_file_in_the_folder_is_not_equal_on_any_processor(elsewhere):
    (elsewhere / "copy.csv").write_text("edited")
    assert replayed(elsewhere).agreement is Agreement.DIFFERENT


@pytest.mark.parametrize(
    ("before", "now", "same"),
    [
        ('{"a":1.25}', '{"a":1.2500000001}', True),
        ('{"a":0.0}', '{"a":-2.4e-17}', True),
        ('{"a":12}', '{"a":13}', False),
        ('{"a":1.25}', '{"a":1.26}', False),
        ('{"a":1.25}', '{"a":1.25,"b":1}', False),
        ("x 1.5", "y 1.5", False),
        ('{"expected_mm":-0.000474,"b":1}', '{"expected_mm":-0.000471,"b":1}', True),
        ('{"expected_mm":-0.000474,"b":1}', '{"expected_mm":-0.000574,"b":1}', False),
        ('{"expected_mm":0.5,"b":0.000474}', '{"expected_mm":0.5,"b":0.000471}', False),
        (f"{'a' * 64} and {'a' * 64}", f"{'b' * 64} and {'b' * 64}", True),
        (f"{'a' * 64} and {'a' * 64}", f"{'b' * 64} and {'c' * 64}", False),
    ],
)
def test_texts_are_the_same_within_the_tolerance_if_nothing_but_their_numbers_differ(before, now, same):
    assert same_within_tolerance(before, now) is same
