"""A cell file names its devices under `devices:`; every other key at its top level is a known one."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError

ROBOT = Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml"
PROBE = "contact+serial:///dev/ttyACM0?baud=250000"


@pytest.fixture
def load(tmp_path: Path):
    def loaded(text: str) -> Cell:
        (tmp_path / "cell.yaml").write_text(f"name: a cell\nmodel: {ROBOT}\n{text}")
        return Cell.load(tmp_path / "cell.yaml", DriverRegistry())

    return loaded


def refused(load, text: str) -> list[tuple[int, str, str]]:
    """Line, what and cure of each error."""
    with pytest.raises(InputError) as caught:
        load(text)
    return [(problem.line, problem.what, problem.cure) for problem in caught.value.problems]


def test_devices_are_found_by_the_names_in_their_section(load) -> None:
    assert {name: str(address) for name, address in load(f"devices: {{feeler: '{PROBE}'}}\n").addresses.items()} == {
        "feeler": PROBE
    }


def test_an_address_at_top_level_is_reported_where_it_belongs(load) -> None:
    old = refused(load, f"robot: kuka+rsi://0.0.0.0:1\nprobe: {PROBE}\nsimulat: {{seed: 1}}\n")
    assert [(line, what) for line, what, _ in old] == [
        (3, "'robot' is an address at top level"),
        (4, "'probe' is an address at top level"),
        (5, "'simulat' is not known here"),
    ]
    assert "under `devices:`" in old[0][2]


@pytest.mark.parametrize(
    ("key", "meant"), [("device", "devices"), ("limit", "limits"), ("simulated", "simulate"), ("artifact", "artefact")]
)
def test_a_misspelt_key_is_an_error_with_what_is_probably_meant(load, key: str, meant: str) -> None:
    assert refused(load, f"devices: {{probe: '{PROBE}'}}\n{key}: {{}}\n") == [
        (4, f"'{key}' is not known here", f"did you mean '{meant}'?")
    ]


@pytest.mark.parametrize("text", ["", "devices: {}\n"])
def test_a_cell_without_device_is_refused(load, text: str) -> None:
    assert [what for _, what, _ in refused(load, text)] == ["the cell has no device"]


@pytest.mark.parametrize("value", ["7", "{port: 1}", "/dev/ttyACM0"])
def test_what_is_no_address_is_named_at_its_line(load, value: str) -> None:
    ((line, what, _),) = refused(load, f"devices:\n  probe: {value}\n")
    assert line == 4
    assert what.startswith("probe: ")
    assert "address" in what


@pytest.mark.parametrize("name", ["control", "time", "seed", "pid", "table"])
def test_a_device_cannot_have_a_name_that_the_ready_file_or_the_limits_use(load, name: str) -> None:
    ((line, what, cure),) = refused(load, f"devices: {{{name}: '{PROBE}'}}\n")
    assert (line, what) == (3, f"a device cannot be called '{name}'")
    assert cure.startswith("give it another name: ")


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("devices:\n", "empty"),
        ("devices: [probe]\n", "a list"),
        (f"devices: {PROBE}\n", "text"),
        ("devices: 7\n", "a single value (7)"),
    ],
)
def test_devices_that_are_no_mapping_are_refused_in_our_words(load, text: str, kind: str) -> None:
    cure = "write `NAME: ADDRESS` lines below it"
    assert refused(load, text) == [(3, f"`devices:` is {kind}", cure)]


def test_errors_in_what_the_report_states_are_reported_at_their_line(load) -> None:
    text = f"devices: {{probe: '{PROBE}'}}\nreport:\n  custmer: ACME\n  limit_mm: 0\n  calibrated:\n"
    found = refused(load, text + "    probe: {date: last spring}\n")
    assert [line for line, _, _ in found] == [5, 6, 8]
    assert found[0][2] == "did you mean 'customer'?"
    assert "'last spring' is no date; write it as 2026-03-01" in found[2][1]


def test_a_calibration_date_of_no_device_is_refused(load) -> None:
    text = f"devices: {{probe: '{PROBE}'}}\nreport: {{calibrated: {{tracker: {{date: 2026-03-01}}}}}}\n"
    assert refused(load, text) == [(4, "there is no device 'tracker'", "known are probe, artefact")]


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("modbus+tcp://0.0.0.0", "the address of no device"),
        ("modbus+tcp://300.1.1.1", "no IP address"),
        ("kuka+varproxy://224.0.0.1", "the address of no device"),
        ("kuka+rsi://0.0.0.0:49152?ethernet=x.xml&eki=172.31.1:54600", "no IP address"),
        ("canopen+socketcan://can0?nodes=1,2,3,4,5", "nodes names 5 drives, and the robot has 6 axes"),
    ],
)
def test_hosts_that_cannot_be_and_nodes_that_do_not_fit_the_axes_are_refused_at_their_line(
    load, address: str, words: str
) -> None:
    found = refused(load, f"devices:\n  one: '{address}'\n")
    assert any(words in what and line == 4 for line, what, _ in found), found
