"""What a line of KRL is understood to be; a line that is not understood keeps its place and has a reason."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.krl import (
    Aggregate,
    Assignment,
    Begin,
    Control,
    Declaration,
    End,
    EndFold,
    Fold,
    FrameData,
    Header,
    Invocation,
    KrlFile,
    Operation,
    Reference,
    Spline,
    Unknown,
    motion_frames,
)
from cellctl.pendant_import._krl import krl_points


def read(text):
    return KrlFile.parse(text.encode("latin-1"), "test.src")


def only(text):
    (statement,) = read(text).statements
    return statement


@pytest.mark.parametrize(
    ("line", "kind", "target", "tail"),
    [
        ("PTP XP1", "PTP", "XP1", ()),
        ("  ptp\tHome C_PTP C_DIS", "PTP", "Home", ("C_PTP", "C_DIS")),
        ("LIN P[3] C_VEL", "LIN", "P[3]", ("C_VEL",)),
        ("SPTP XP1 WITH $VEL_AXIS[1]=SVEL_JOINT(100.0), $TOOL=STOOL2(FP1) C_SPL", "SPTP", "XP1", ("C_SPL",)),
        ("SPL XP4", "SPL", "XP4", ()),
        ("LIN FP.ZIEL", "LIN", "FP.ZIEL", ()),
    ],
)
def test_a_motion_names_its_point(line, kind, target, tail):
    motion = only(line)
    assert (motion.kind, motion.target.written, motion.approximation) == (kind, target, tail)


def test_a_circle_has_an_auxiliary_point_and_an_angle():
    motion = only("CIRC XP4, XP5, CA -270.5 C_DIS")
    assert (motion.auxiliary.written, motion.target.written) == ("XP4", "XP5")
    assert motion.circular_angle.value == -270.5
    assert only("SCIRC XP4,XP5 WITH $ACC=SACC_CP(LCPDAT1)").circular_angle is None


def test_the_settings_of_with_are_assignments():
    motion = only("SLIN XP3 WITH $VEL=SVEL_CP(0.1, , LCPDAT1), $TOOL=STOOL2(FP3), $BASE= SBASE(FP3.BASE_NO)")
    assert [setting.target.written for setting in motion.settings] == ["$VEL", "$TOOL", "$BASE"]
    assert motion.settings[2].value.arguments[0].written == "FP3.BASE_NO"


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ("PTP XP1:OFFSET", Operation),
        ("LIN {X 100}", Aggregate),
        ("LIN {X 100, Y Y0+5}", Aggregate),
        ("LIN P[I]", Reference),
    ],
)
def test_a_computed_point_is_seen_as_one(line, kind):
    motion = only(line)
    assert isinstance(motion.target, kind)
    points = read(line).points
    literal = next(iter(points), None)
    certain = isinstance(motion.target, Reference) and motion.target.certain
    assert not certain
    assert literal is None or literal.fault or literal.missing


def test_relative_motions_have_a_distance_and_no_point():
    file = read("LIN_REL {X 10,Z -5} #TOOL\n")
    assert (file.motions[0].kind, file.motions[0].reference) == ("LIN_REL", "#TOOL")
    assert file.points == ()


def test_numbers_are_read_in_every_way_of_writing_and_with_their_place():
    file = read("DECL E6POS XP1={X 1.0E-3,Y -90,Z +5,A .5,B -2.E1,C #ZERO,S 'H2',T 'B 100011'}")
    point = file.points[0]
    assert list(point.values.values()) == [0.001, -90, 5, 0.5, -20, 2, 35]
    assert file.source(point.numbers["Y"].span) == "-90"
    assert point.fault == "C '#ZERO' is not a number"


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ("&ACCESS RVP", Header),
        ("DEF TEST( )", Begin),
        ("GLOBAL DEFFCT E6POS MITTE(P1:IN,P2:IN)", Begin),
        ("DEFDAT TEST PUBLIC", Begin),
        ("enddat", End),
        (";FOLD INI;%{PE}", Fold),
        ("; ENDFOLD (INI)", EndFold),
        ("DECL GLOBAL INT I,J[3]", Declaration),
        ("BOOL FERTIG", Declaration),
        ("$BASE=BASE_DATA[2]", Assignment),
        ('BASE_NAME[1,]="Tisch; links"', Assignment),
        ("BAS (#INITMOV,0 )", Invocation),
        ("PICK( )", Invocation),
        ("GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )", Control),
        ("TRIGGER WHEN DISTANCE=0 DELAY=-20 DO $OUT[3]=TRUE", Control),
        ("IF (A==1) AND NOT $IN[3] THEN", Control),
        ("WAIT FOR ($IN[1]) OR ($IN[2])", Control),
        ("SCHLEIFE:", Control),
        ("STRUC PAAR E6POS A,B", Control),
        ("EXT BAS (BAS_COMMAND :IN,REAL :IN )", Control),
        ("SPLINE WITH $VEL={CP 0.1,ORI1 200,ORI2 200}", Spline),
        ("ENDSPLINE C_SPL", Spline),
    ],
)
def test_other_statements_are_read_as_what_they_are(line, kind):
    assert isinstance(only(line), kind)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("DECL E6POS XP1={X 1.0,Y 2.0", "'}' is missing"),
        ("DECL E6AXIS XP1={A1 1,5,A2 2}", "decimal points"),
        ("PTP", "a value is missing: the line ends"),
        ("CIRC XP1", "',' is missing"),
        ("LIN XP1 XP2", "'XP2' is not understood here"),
        ('MELDUNG[]="ohne Ende', "does not end on this line"),
        ("XP1=", "a value is missing"),
        ("WAIT FOR ($IN[1]", "'(' is not closed"),
        ("?", "'?' is no character of KRL"),
        ("PTP " + "(" * 500 + "XP1" + ")" * 500, "nested"),
    ],
)
def test_a_line_that_is_not_understood_has_a_reason(line, reason):
    statement = only(line)
    assert isinstance(statement, Unknown)
    assert reason in statement.reason


def test_an_inline_form_is_read_from_its_fold():
    fold = only(";FOLD CIRC P40 P41 CONT Vel=2 m/s CPDAT40 Tool[1]:EOAT 1 Base[3]:Tisch;%{PE}%R 8.3.43,%MKUKATPBASIS")
    form = fold.form
    assert (form.kind, form.points, form.approximated, form.data) == ("CIRC", ("P40", "P41"), True, "CPDAT40")
    assert (form.tool, form.tool_name, form.base, form.base_name) == (1, "EOAT 1", 3, "Tisch")
    assert only(";FOLD PTP HOME  Vel= 100 % DEFAULT;%{PE}").form.points == ("HOME",)
    assert only(";FOLD Parameters ;%{h}").form is None
    assert only(";FOLD PTP to the table").form is None


def test_frame_data_gives_tool_and_base():
    file = read('DEFDAT T\nDECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}\nENDDAT')
    assert file.frame_data("fp1") == FrameData(1, 0, "#BASE", " ")
    assert file.frame_data("FP2") is None


def test_what_may_change_a_point_is_named():
    text = "XP1.Z=XP1.Z+10\nXP2=XP1\nHOLE(XP1)\nXP3=MITTE(XP1,XP2)\nPTP XP1\nWAIT FOR XP1.X>5\n"
    assert [statement.line for statement in read(text).changes("xp1")] == [1, 3, 4, 6]
    called = "DEF GO(P:IN,Q:OUT)\nEND\nDEF MAIN( )\nGO(XP1,XP2)\nXP3=INV_POS(XP4)\nEND\n"
    assert [len(read(called).changes(name)) for name in ("XP1", "XP2", "XP3", "XP4")] == [0, 1, 1, 0]
    assert read("DEFDAT T\nXP1={X 1}\nENDDAT\nDEF T( )\nPTP XP1\nEND").changes("XP1") == ()


def test_only_the_named_places_change():
    file = read("\tDECL  E6POS\tXP1 = { X 1.50 , Y -2 }  ; Höhe\r\nLIN XP1\n")
    numbers = file.points[0].numbers
    changed = file.replaced({numbers["Y"].span: "-2.125", numbers["X"].span: "1.6"})
    assert changed == "\tDECL  E6POS\tXP1 = { X 1.6 , Y -2.125 }  ; Höhe\r\nLIN XP1\n".encode("latin-1")
    with pytest.raises(ValueError, match="overlap"):
        file.replaced({numbers["Y"].span: "1", file.points[0].span: "2"})


PIECES = st.sampled_from(
    ["PTP ", "LIN ", "CIRC ", "DECL ", "E6POS ", "XP1", "=", "{", "}", "X ", "1.5", "-", ",", ":", "(", ")", "[", "]",
     ";FOLD ", "\r\n", "\n", "\r", "\t", '"', "#BASE", ".", "WITH ", "DEF ", "END", "&ACCESS", "\xe4", "\0"]
)  # fmt: skip


PROGRAMS = [path.read_bytes() for path in sorted((Path(__file__).parent / "programs").glob("[!.]*"))]


@st.composite
def damaged_programs(draw):
    """A program with a piece cut out and other bytes in its place."""
    data = draw(st.sampled_from(PROGRAMS))
    start = draw(st.integers(0, len(data)))
    end = draw(st.integers(start, min(len(data), start + 60)))
    return data[:start] + draw(st.binary(max_size=8)) + data[end:]


@given(
    st.one_of(
        st.binary(),
        damaged_programs(),
        st.lists(PIECES, max_size=40).map(lambda pieces: "".join(pieces).encode("latin-1")),
    )
)
def test_any_bytes_are_read_and_given_back(data):
    file = KrlFile.parse(data, "any")
    places = {statement.span: file.source(statement.span) for statement in file.statements}
    assert file.replaced(places) == data
    spans = [statement.span for statement in file.statements]
    assert spans == sorted(spans)
    assert len(motion_frames(file, [file])) == len(file.motions)
    for point in file.points:
        assert all(data[span.start : span.end].strip() for span in point.spans().values())
        file.changes(point.name)
    assert all(raw.line for raw in krl_points(file.text, "any").points)
