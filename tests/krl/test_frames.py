"""Which tool and base is in force at a motion, and where a program does not say it for certain."""

import pytest

from cellctl.krl import KrlFile, frame_values, motion_frames

DATA = """\
DEFDAT T
DECL FDAT FP1={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}
DECL FDAT FP2={TOOL_NO 3,BASE_NO 0,IPO_FRAME #TCP,POINT2[] " "}
ENDDAT
"""
CONFIG = """\
DEFDAT $CONFIG PUBLIC
BASE_DATA[2]={X 100.0,Y 200.0,Z 300.0,A 10.0,B 0.0,C 0.0}
TOOL_DATA[1]={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}
TOOL_DATA[4]={X 1.0,Y 2.0}
ENDDAT
"""
ONE = "$BASE=BASE_DATA[1]"
OLD_FORM = "PDAT_ACT=PPDAT1\nFDAT_ACT=F{0}\nBAS(#PTP_PARAMS,100)\nPTP X{0}\n"


def read(text, name="t.src"):
    return KrlFile.parse(text.encode("latin-1"), name)


def frames(program, *, data=DATA):
    return motion_frames(read(program), [read(data, "t.dat"), read(CONFIG, "$config.dat")])


def numbers(program):
    return [(found.tool.number, found.base.number) for found in frames(program)]


def test_an_inline_form_has_the_frames_of_its_fdat():
    assert numbers(OLD_FORM.format("P1") + OLD_FORM.format("P2")) == [(1, 2), (3, 0)]
    assert [found.fixed_tool for found in frames(OLD_FORM.format("P1") + OLD_FORM.format("P2"))] == [False, True]


def test_a_spline_form_has_the_frames_of_its_with_and_leaves_the_others_alone():
    program = (
        "$TOOL=TOOL_DATA[5]\n$BASE=BASE_DATA[6]\nSLIN XP1 WITH $TOOL=STOOL2(FP1), $BASE=SBASE(FP1.BASE_NO)\nLIN XP2\n"
    )
    assert numbers(program) == [(1, 2), (5, 6)]


def test_a_spline_block_gives_its_frames_to_its_segments():
    block = "SPLINE WITH $TOOL=TOOL_DATA[1], $BASE=$NULLFRAME\nSLIN XP1\nSPL XP2 WITH $BASE=BASE_DATA[2]\nENDSPLINE\n"
    program = block + "LIN XP3\n"
    assert numbers(program) == [(1, 0), (1, 2), (None, None)]


@pytest.mark.parametrize(
    ("line", "tool"),
    [
        ("$TOOL=TOOL_DATA[4]", 4),
        ("$tool = tool_data[ 4 ]", 4),
        ("BAS(#TOOL,4)", 4),
        ("$TOOL=$NULLFRAME", 0),
        ("$TOOL=TOOL_DATA[N]", None),
        ("$TOOL=TOOL_DATA[4]:OFFSET", None),
        ("$TOOL=TOOL_DATA[4]\n$TOOL.Z=5", None),
        ("$TOOL=TOOL_DATA[4]\nPICK( )", None),
        ("$TOOL=TOOL_DATA[4]\nAGAIN:", None),
        ("$TOOL=TOOL_DATA[4]\nEND\nDEF SUB( )", None),
        ("$TOOL=TOOL_DATA[4]\n$TOOL=(", None),
        ("$TOOL=TOOL_DATA[4]\nGRIP(,", None),
        ("$TOOL=TOOL_DATA[4]\nTRIGGER WHEN DISTANCE=0 DELAY=0 DO $TOOL=TOOL_DATA[5]", None),
        ("$TOOL=TOOL_DATA[4]\nTRIGGER WHEN DISTANCE=0 DELAY=0 DO $OUT[1]=TRUE", 4),
        ("$TOOL=TOOL_DATA[4]\nWAIT FOR $IN[1] AND (X>1)\nXP2 XP3 XP4", 4),
    ],
)
def test_the_tool_of_a_motion_is_certain_or_has_a_reason(line, tool):
    (found,) = frames(f"{line}\nLIN XP1\n")
    assert found.tool.number == tool
    assert bool(found.tool.reason) == (tool is None)


@pytest.mark.parametrize(
    ("program", "bases"),
    [
        ("IF A THEN\n$BASE=BASE_DATA[1]\nLIN XP1\nENDIF\nLIN XP2", [1, None]),
        ("IF A THEN\n$BASE=BASE_DATA[1]\nELSE\n$BASE=BASE_DATA[1]\nENDIF\nLIN XP1", [1]),
        ("$BASE=BASE_DATA[1]\nIF A THEN\nLIN XP1\nENDIF\nLIN XP2", [1, 1]),
        (f"SWITCH N\nCASE 1\n{ONE}\nCASE 2,3\n{ONE}\nDEFAULT\n{ONE}\nENDSWITCH\nLIN P", [1]),
        ("SWITCH N\nCASE 1\n$BASE=BASE_DATA[1]\nENDSWITCH\nLIN P", [None]),
        ("$BASE=BASE_DATA[1]\nLOOP\nLIN XP1\nENDLOOP", [1]),
        ("$BASE=BASE_DATA[1]\nLOOP\nLIN XP1\n$BASE=BASE_DATA[2]\nLIN XP2\nENDLOOP\nLIN XP3", [None, 2, None]),
        ("$BASE=BASE_DATA[1]\nENDIF\nLIN XP1", [None]),
    ],
)  # fmt: skip
def test_a_base_is_certain_after_a_branch_or_in_a_loop_only_if_all_ways_agree(program, bases):
    assert [found.base.number for found in frames(program)] == bases


def test_a_frame_written_out_and_a_numbered_one_have_their_values():
    written, numbered = frames("$BASE={X 1,Y 2,Z 3,A 4,B 5,C 6}\nLIN P\n$BASE=BASE_DATA[2]\nLIN P\n")
    files = [read(CONFIG)]
    assert list(frame_values(written.base, "BASE_DATA", files).values()) == [1, 2, 3, 4, 5, 6]
    assert frame_values(numbered.base, "BASE_DATA", files)["X"] == 100.0
    missing, partial = frames("$TOOL=TOOL_DATA[9]\nLIN P\n$TOOL=TOOL_DATA[4]\nLIN P\n")
    assert frame_values(missing.tool, "TOOL_DATA", files) is None
    assert frame_values(partial.tool, "TOOL_DATA", files) is None


def test_a_missing_fdat_is_named():
    (found,) = frames(OLD_FORM.format("HOME"))
    assert "FHOME" in found.tool.reason


def test_a_program_that_changes_an_fdat_or_the_frames_themselves_has_uncertain_frames():
    (fdat,) = frames("FP1.TOOL_NO=2\n" + OLD_FORM.format("P1"))
    assert "line 1 may change FP1" in fdat.tool.reason
    (array,) = frames("$BASE=BASE_DATA[2]\nBASE_DATA[2].Z=5\nLIN XP1\n")
    assert "line 2 may change BASE_DATA" in array.base.reason


@pytest.mark.parametrize(
    ("body", "base"), [("$OUT[1]=TRUE\nLIN XP9", 1), ("GRIP( )", 1), ("$BASE=BASE_DATA[2]", None), ("OTHER( )", None)]
)
def test_a_subprogram_of_the_same_file_leaves_the_frames_if_it_sets_none(body, base):
    program = f"DEF MAIN( )\n$BASE=BASE_DATA[1]\nGRIP( )\nLIN XP1\nEND\nDEF GRIP( )\n{body}\nEND\n"
    assert frames(program)[0].base.number == base


def test_points_of_an_array_have_their_own_fdat():
    data = "DEFDAT T\nDECL FDAT FP[2]\nFP[1]={TOOL_NO 1,BASE_NO 2}\nFP[2]={TOOL_NO 3,BASE_NO 4}\nENDDAT\n"
    program = "SLIN P[2] WITH $TOOL=STOOL2(FP[2]), $BASE=SBASE(FP[2].BASE_NO)\n"
    (found,) = frames(program, data=data)
    assert (found.tool.number, found.base.number) == (3, 4)
