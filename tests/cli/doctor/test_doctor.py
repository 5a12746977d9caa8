"""`cellctl doctor`: every device of a cell is tried, one row each, and nothing moves."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest

from tests.helpers.runs import cell_with, cellctl, faults

PLC = {"devices:\n": "devices:\n  plc: modbus+tcp://192.168.10.5:502?unit=1\n"}


def examined(folder: Path, cell: Path):
    """The exit code, the JSON's devices by name, and what was printed."""
    done = cellctl("doctor", cell, "--json", folder / "doctor.json")
    devices = json.loads((folder / "doctor.json").read_text())["devices"]
    return done.returncode, {device["name"]: device for device in devices}, done


@pytest.mark.long
def test_a_healthy_cell_has_a_row_for_each_device_and_nothing_moves(tmp_path):
    moved = faults("fault: plc.clamp, event: robot.move", "fault: plc.clamp, event: robot.search")
    code, devices, done = examined(tmp_path, cell_with(tmp_path, moved, PLC))
    assert code == 0, done.stderr
    assert list(devices) == ["plc", "robot", "probe"]
    for name, device in devices.items():
        assert device["healthy"]
        assert device["identity"]["simulated"]
        assert device["identity"]["serial"] in done.stdout
        assert 0.0 < device["latency_ms"] < 50.0
        assert any(line.startswith(name) and "ok" in line for line in done.stdout.splitlines())
    assert devices["probe"]["clock"]["drift_ppm"] == pytest.approx(0.0, abs=100.0)
    assert 0.0 < devices["probe"]["clock"]["sigma_ms"] < 1.0
    assert devices["plc"]["clock"] is None


@pytest.mark.long
def test_a_device_that_fails_is_named_with_its_cure_and_the_others_are_examined(tmp_path):
    code, devices, done = examined(tmp_path, cell_with(tmp_path, faults("fault: plc.gone"), PLC))
    assert code == 3
    assert {name: device["healthy"] for name, device in devices.items()} == {"plc": False, "robot": True, "probe": True}
    assert "cellctl: plc: " in done.stderr
    assert "check the network cable" in done.stderr
    assert "FAILED" in done.stdout
    assert len(done.stderr.splitlines()) == 2, "the library's own log is not shown"


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "device", "words"),
    [
        ("plc.sensor", "plc", "broken sensors: air temperature"),
        ("safety.emergency_stop", "robot", "EMERGENCY STOP"),
        ("probe.wire_break", "probe", "loop at"),
    ],
)
def test_a_device_that_answers_and_reports_a_fault_is_not_healthy(tmp_path, fault, device, words):
    code, devices, done = examined(tmp_path, cell_with(tmp_path, faults(f"fault: {fault}"), PLC))
    assert code == 3
    assert [name for name, one in devices.items() if not one["healthy"]] == [device]
    assert words in done.stderr


@pytest.mark.long
def test_every_device_of_a_real_cell_that_does_not_answer_is_named(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    cell = cell_with(tmp_path, "", {"simulate:\n  seed: 1\n  clock: lockstep": ""})
    text = cell.read_text().partition("devices:")
    rest = text[2].partition("limits:")[2].partition("artefact:")[2]
    devices = f"devices:\n  plc: modbus+tcp://127.0.0.1:{port}\n  probe: contact+serial:///dev/no-such-port\nartefact:"
    cell.write_text(text[0] + devices + rest)
    code, found, done = examined(tmp_path, cell)
    assert code == 3
    assert not any(device["healthy"] for device in found.values())
    assert f"cellctl: plc: no Modbus connection to 127.0.0.1:{port}" in done.stderr
    assert "cellctl: probe: /dev/no-such-port cannot be opened" in done.stderr


@pytest.mark.long
def test_a_cell_file_with_errors_is_refused_before_anything_is_opened(tmp_path):
    cell = cell_with(tmp_path, "", {"contact+serial://": "contact+cereal://"})
    done = cellctl("doctor", cell)
    assert done.returncode == 2
    assert "no driver for 'contact+cereal://'" in done.stderr
    assert done.stdout == ""
