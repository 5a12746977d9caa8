"""What `cellctl krl` writes for a controller with a variable proxy; the judgement of a job is run by an interpreter."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, Surroundings, TableInfo
from drivers.kuka_varproxy import variables
from drivers.kuka_varproxy.description import controller_files
from drivers.kuka_varproxy.moving import Job
from drivers.kuka_varproxy.tables import _NAMES, _head, _row_text
from drivers.kuka_varproxy.variables import fields
from tests.helpers.krl import Krl

POINT = (1.23456, -90.0, 90.00004, -170.5, 45.0, 349.9999)
REFERENCE = (Path(__file__).parents[3] / "docs/reference/varproxy-channel.md").read_text()


@pytest.fixture(scope="module")
def made():
    address = Address.parse("kuka+varproxy://172.31.1.147:7001")
    return controller_files("a cell", address, Surroundings(WallClock(), Path(), {"speed_percent": 25.9}))


@pytest.fixture
def krl(made):
    """The program, idle in EXT; axis limits ± 350 deg; one table of a row in bank 2, which is active."""
    found = Krl([made["cellctl_kvp.src"], made["cellctl_kvp.dat"]], {})
    found.variables |= {
        "$MODE_OP": "#EX",
        "$SOFTN_END": {(axis,): -350.0 for axis in range(1, 7)},
        "$SOFTP_END": {(axis,): 350.0 for axis in range(1, 7)},
        "$AXIS_ACT": {f"A{axis}": 0.0 for axis in range(1, 7)},
        "KV_ROLES": 210,
        "KV_BANK": {(2,): {"TAKEN": 1}},
        "KV_TAB": {(2, 1): {name: n * 1_000_000 for n, name in enumerate(_NAMES)}},
    }
    return found


def judged(krl, number=7, joints=POINT, percent=20, row=0, **changed):
    """The outcome of the job that the driver writes."""
    job = {name: int(value) for name, value in fields(Job(joints, percent, row).written(7)).items()}
    krl.variables["KV_JOB"] = {**job, **changed}
    return krl.call("KV_JUDGE", number)


def test_the_drivers_job_is_accepted_and_its_target_is_the_point(krl):
    assert judged(krl) == 0
    assert [krl.variables["KV_TARGET"][f"A{axis}"] for axis in range(1, 7)] == pytest.approx(POINT, abs=6e-5)


def test_a_row_of_the_active_table_is_the_target(krl):
    assert judged(krl, row=1) == 0
    assert [krl.variables["KV_TARGET"][f"A{axis}"] for axis in range(1, 7)] == [6.0, 7.0, 8.0, 9.0, 10.0, 11.0]


@pytest.mark.parametrize(
    ("job", "outcome"),
    [
        ({"A3": 900001}, 22),
        ({"PERCENT": 21}, 22),
        ({"number": 8}, 22),
        ({"percent": 26}, 21),
        ({"percent": 0}, 21),
        ({"row": 2}, 42),
        ({"joints": (351.0, 0.0, 0.0, 0.0, 0.0, 0.0)}, 20),
        ({"joints": (0.0, 0.0, 0.0, 0.0, 0.0, -351.0)}, 20),
    ],
)
def test_a_job_that_must_not_be_is_refused(krl, job, outcome):
    assert judged(krl, **job) == outcome


def test_in_t1_only_where_the_data_list_allows_it(krl):
    krl.variables["$MODE_OP"] = "#T1"
    assert judged(krl) == 12
    krl.variables["KV_ALLOW_T1"] = True
    assert judged(krl) == 0
    krl.variables["$MODE_OP"] = "#T2"
    assert judged(krl) == 12


def test_without_an_active_table_no_row_is_a_target(krl):
    for roles in (0, 21, 910):
        krl.variables["KV_ROLES"] = roles
        assert judged(krl, row=1) == 42


def test_the_drivers_structures_have_the_fields_of_the_data_list(made):
    declared = {
        kind: re.findall(r"(?:INT|CHAR) (\w+)", rest)
        for kind, rest in re.findall(r"^GLOBAL STRUC (\w+) (.*)$", made["cellctl_kvp.dat"], re.MULTILINE)
    }

    def written(text):
        return [name.removesuffix("[]") for name in fields(text)]

    assert written(Job(POINT, 20).written(1)) == declared[variables.JOB_KIND]
    assert written(_row_text(tuple(range(12)))) == declared[variables.ROW_KIND]
    assert written(_head(TableInfo("id", 3, "01234567"), taken=0)) == declared[variables.BANK_KIND]


def test_every_variable_that_the_reference_names_is_declared(made):
    declared = set(re.findall(r"^DECL GLOBAL \w+ (KV_\w+)", made["cellctl_kvp.dat"], re.MULTILINE))
    named = set(re.findall(r"`(KV_[A-Z0-9_]+?)(?:\[[^`]*)?`", REFERENCE))
    assert named
    assert named <= declared | {variables.JOB_KIND, variables.ROW_KIND, variables.BANK_KIND}


def test_the_files_are_filled_in_ascii_and_say_that_nobody_tried_them(made):
    assert set(made) == {"cellctl_kvp.src", "cellctl_kvp.dat", "README.txt"}
    for text in made.values():
        assert text.isascii()
        assert not re.search(r"@[A-Z]", text)
        assert "not tried on a real" in text.lower()
    assert "172.31.1.147:7001" in made["README.txt"]
    assert f"$FLAG[{variables.FLAG_STOP}]" in made["cellctl_kvp.src"]
    assert "for a cell." in made["cellctl_kvp.src"]
