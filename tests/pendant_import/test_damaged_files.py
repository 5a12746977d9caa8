"""Damaged files of every format are read in part or refused, each with a place; no other exception comes."""

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.pendant_import import choices, imported, imported_targets

FILES = {
    "krl": "DEFDAT M\nDECL E6POS XP1={X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0,S 2,T 35}\n"
    "DECL E6AXIS XP2={A1 1.0,A2 2.0,A3 3.0,A4 4.0,A5 5.0,A6 66.0}\nENDDAT\n",
    "rapid": "MODULE M\nCONST jointtarget p2:=[[1,2,3,4,5,66],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    "CONST robtarget p1:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\nMoveL p1,v100,fine,t\\WObj:=w;\n",
    "fanuc": "/PROG M\n/POS\nP[2]{\n   GP1:\n\tUF : 0, UT : 1,\n\tJ1= 1 deg, J2= 2 deg, J3= 3 deg,\n"
    "\tJ4= 4 deg, J5= 5 deg, J6= 6 deg\n};\nP[1]{\n   GP1:\n\tUF : 0, UT : 1, CONFIG : 'N U T, 0, 0, 0',\n"
    "\tX = 1 mm, Y = 2 mm, Z = 3 mm,\n\tW = 4 deg, P = 5 deg, R = 6 deg\n};\n/END\n",
    "script": "P2_q=[0.1, -1.2, 0, 0, 0, 1.5]\nP1_p=p[.1,.2,.3,0,1,0]\nmovej([0.1, 0.2, 0.3, d2r(90), 1, 2], a=1.4)\n",
    "table": "// Units: mm\n// Collection, Group, Point, X, Y, Z, Ux, Uy, Uz, Time\n"
    "A, Main, P2, 1203.45, -311.02, 982.11, 0.01, 0.02, 0.03, 10:00\n"
    "A, Main, P1, 1.5, 2.5, 3.5, 0.01, 0.02, 0.03, 10:01\n",
}
POSITIONS = "Name;X [mm];Y [mm];Z [mm]\nP2;1,5;2,5;3,5\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("damaged")
    (place / "positions.csv").write_text(POSITIONS)
    (place / "joints.dat").write_text(FILES["krl"])
    return place


@pytest.mark.parametrize("kind", FILES)
@given(
    cut=st.tuples(st.integers(0, 400), st.integers(0, 30)),
    put=st.text(alphabet="[]{}(),;:=\"'!/\\ \n\t1.5eEX-*°", max_size=4),
)
@settings(max_examples=30, deadline=None)
def test_a_damaged_file_gives_rows_or_an_error_with_its_place(folder, kind, cut, put):
    text, start = FILES[kind], cut[0] % len(FILES[kind])
    path = folder / "damaged.txt"
    path.write_text(text[:start] + put + text[start + cut[1] :])
    both = {"table": (folder / "joints.dat", path)}.get(kind, (path, folder / "positions.csv"))
    for work in (
        lambda: imported(*both, choices({"j3": "arm"})),
        lambda: imported_targets(path, choices({})),
        lambda: imported_targets(path, choices({"orientation": "fixed-xyz", "unit": "mm"}, coverage=1.0)),
    ):
        with contextlib.suppress(InputError):
            assert work().records


@pytest.mark.parametrize("kind", FILES)
def test_the_files_are_read_while_they_are_whole(folder, kind):
    path = folder / "whole.txt"
    path.write_text(FILES[kind])
    both = {"table": (folder / "joints.dat", path)}.get(kind, (path, folder / "positions.csv"))
    assert len(imported(*both, choices({"j3": "arm"})).records) == 1
    if kind != "table":
        assert len(imported_targets(path, choices({})).records) == 1
