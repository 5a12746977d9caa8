"""Programs and data lists as people have them: unchanged to the byte, and understood as expected.

They were written for these tests from the language's documentation: inline forms of KSS 8.3 and 8.5, spline blocks,
interrupts, nested folds, `$config.dat`, subprograms, umlauts in Latin-1, tabs, mixed line ends, a missing END, …
"""

from pathlib import Path

import pytest

from cellctl.krl import EndFold, Fold, KrlFile, Reference, motion_frames

PROGRAMS = Path(__file__).parent / "programs"
NAMES = sorted(path.name for path in PROGRAMS.iterdir() if not path.name.startswith("."))

# file: motions (`-`: not to a named point), points with values (`-`: in a motion), lines that are not understood
EXPECTED = {
    "arrays.src": ("LIN GRID[?,1], LIN GRID[?,2], PTP GRID[1,1]", "GRID[1,1] GRID[1,2] GRID[?,1]", []),
    "circles.src": ("LIN XP1, CIRC XP3, CIRC XP3, CIRC -, SCIRC XP3", "- -", []),
    "computed.src": (
        "PTP P, LIN -, LIN -, LIN -, LIN -, LIN -, CIRC XP6, PTP $POS_ACT", "- -", [],
    ),
    "config.dat": ("", "XHOME BASE_DATA[1] BASE_DATA[2] TOOL_DATA[1] TOOL_DATA[2]", []),
    "control_flow.src": ("PTP XP1, PTP XP2, LIN XP3, LIN XP4, LIN XP5, PTP XP6", "", []),
    "damaged.src": ("PTP XP1, LIN XP7", "", [3, 4, 5, 6, 7, 8, 9, 10, 11, 13]),
    "edited_on_a_pc.src": ("PTP XP1, LIN XP2", "", []),
    "external_axis.dat": ("", "XP1 XP2 XP3", []),
    "frames_by_hand.src": ("PTP XP1, LIN XP2, LIN XP3, LIN XP4, LIN XP5", "$TOOL", []),
    "german_comments.src": ("PTP XP1, LIN XP2", "", []),
    "inline_83.dat": ("", "XP4 XP5 XP6", []),
    "inline_83.src": ("PTP XP4, CIRC XP6", "", []),
    "inline_85.dat": ("", "XP1 XP2", []),
    "inline_85.src": ("PTP XHOME, PTP XP1, LIN XP2", "", []),
    "interrupts.src": ("PTP XSTART, LIN_REL -, PTP $AXIS_RET", "", []),
    "joint_points.src": ("PTP -, PTP -, PTP $AXIS_ACT, SPTP -", "- - - $H_POS", []),
    "lower_case.src": ("PTP Xp1, LIN xp2, CIRC xp4, SLIN xp5", "", []),
    "missing_end.src": ("PTP XP1, LIN XP2", "", []),
    "mixed_line_ends.src": ("PTP XP1, LIN XP2, LIN XP3, PTP XP4", "", []),
    "nested_folds.src": ("LIN XP1, LIN XP2", "", []),
    "no_final_newline.dat": ("", "XP1 XP2", []),
    "numbers.dat": ("", "XP1 XP2 XP3 XP4 F1 F2 XP5 F3", []),
    "ptp_spline.src": ("SPTP P1, SPTP_REL -, SPTP HOME", "", []),
    "relative.src": ("PTP XP1, PTP_REL -, LIN_REL -, LIN_REL -, CIRC_REL -, LIN_REL SHIFT", "", []),
    "signals.src": ("LIN XP1, LIN XP2", "", []),
    "spline_block.src": ("PTP -, SPL P1, SPL P2, SLIN -, SCIRC P4, SLIN_REL -, SLIN P5", "- -", []),
    "spline_forms.src": ("SPTP XHOME, SLIN XP1, SCIRC XP3", "", []),
    "submit.sub": ("", "", []),
    "subroutines.src": ("LIN XP1, LIN XP2, PTP TARGET", "", []),
    "tabs.src": ("PTP XP1, LIN -", "-", []),
    "umlauts.src": ("LIN -", "-", []),
    "user_types.dat": ("", "", []),
}  # fmt: skip


def load(name):
    return KrlFile.load(PROGRAMS / name)


def test_there_are_thirty_programs_and_each_has_an_expectation():
    assert sorted(EXPECTED) == NAMES
    assert len(NAMES) >= 30


@pytest.mark.parametrize("name", NAMES)
def test_a_program_is_unchanged_when_every_number_is_written_again(name):
    file = load(name)
    spans = [statement.span for statement in file.statements]
    spans += [span for point in file.points for span in point.spans().values()]
    for places in (spans[: len(file.statements)], spans[len(file.statements) :]):
        assert file.replaced({span: file.source(span) for span in places}) == (PROGRAMS / name).read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_a_program_is_understood_as_expected(name):
    file = load(name)
    motions, points, unknown = EXPECTED[name]
    targets = [motion.target.written if isinstance(motion.target, Reference) else "-" for motion in file.motions]
    kinds = [motion.kind for motion in file.motions]
    assert ", ".join(f"{kind} {target}" for kind, target in zip(kinds, targets, strict=True)) == motions
    assert " ".join(point.name or "-" for point in file.points) == points
    assert [statement.line for statement in file.unknown] == unknown


@pytest.mark.parametrize("name", NAMES)
def test_one_changed_number_changes_its_digits_alone(name):
    file = load(name)
    for point in file.points:
        for span in point.spans().values():
            changed = file.replaced({span: "-1234.5678"})
            assert changed[: span.start] == file.data[: span.start]
            assert changed[span.start :].startswith(b"-1234.5678")
            assert changed[span.start + 10 :] == file.data[span.end :]


def test_a_damaged_line_has_its_reason_and_leaves_the_others_alone():
    reasons = {statement.line: statement.reason for statement in load("damaged.src").unknown}
    assert "'}' is missing" in reasons[3]
    assert "decimal points" in reasons[6]
    assert "does not end on this line" in reasons[7]
    assert "'XP5' is not understood here" in reasons[9]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("inline_85.src", [(0, 0), (1, 2), (1, 2)]),
        ("inline_83.src", [(3, 0), (3, 0)]),
        ("spline_block.src", [(None, None), *[(1, 1)] * 5, (None, None)]),
        ("ptp_spline.src", [(1, 3)] * 3),
        ("lower_case.src", [(1, 0)] * 4),
        ("frames_by_hand.src", [(2, 1), (2, 2), (None, 2), (None, None), (None, None)]),
        ("subroutines.src", [(1, 1), (None, None), (None, None)]),
    ],
)
def test_tool_and_base_of_each_motion(name, expected):
    data = [load(other) for other in (name.replace(".src", ".dat"), "config.dat") if (PROGRAMS / other).exists()]
    assert [(found.tool.number, found.base.number) for found in motion_frames(load(name), data)] == expected


def test_numbers_in_every_way_of_writing():
    file = load("numbers.dat")
    assert list(file.point("XP1").values.values()) == [1000, -0.25, 0.5, 180, -0.25, 0, 2, 35]
    assert list(file.point("XP2").values.values()) == [10, -90, 90, -5, 0.5, 10]
    assert [file.point("XP5").values[label] for label in "ST"] == [2, 35]
    assert file.point("F3").fault == "X is given twice"


def test_computed_points_are_not_certain():
    file = load("computed.src")
    assert [point.missing or point.fault for point in file.points] == [
        ("Y", "Z", "A", "B", "C"),
        ("X", "Y"),
    ]
    assert [statement.line for statement in file.changes("P")] == [3, 4]


def test_points_in_comments_and_folds_are_no_points():
    file = load("german_comments.src")
    assert file.points == ()
    assert [motion.line for motion in file.motions] == [5, 7]
    assert [fold.form.points for fold in load("nested_folds.src").of(Fold) if fold.form] == [("P1",)]
    assert len(load("nested_folds.src").of(EndFold)) == 3


def test_the_inline_form_shows_what_its_fold_does():
    program, data = load("inline_85.src"), load("inline_85.dat")
    forms = [fold.form for fold in program.of(Fold) if fold.form]
    assert [(form.kind, form.points, form.tool, form.base) for form in forms] == [
        ("PTP", ("HOME",), None, None),
        ("PTP", ("P1",), 1, 2),
        ("LIN", ("P2",), 1, 2),
    ]
    assert (data.frame_data("FP1").tool_no, data.frame_data("FP1").base_no) == (1, 2)
    assert forms[1].tool_name == "Taster"
