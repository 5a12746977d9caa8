"""`python -m sims` as a process: how it starts, what it leaves, and when it ends."""

import json
import os
import select
import signal
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import pytest
import yaml

from cellctl.clock import reader_of

PATIENCE_S = 90


@pytest.fixture
def probe_cell(request, tmp_path):
    """A cell file with the probe alone, and `simulate` as asked."""
    source = request.config.rootpath / "procedures/cells/sphere_cell.yaml"

    def write(**simulate):
        cell = yaml.safe_load(source.read_text())
        del cell["devices"]["robot"]
        cell["model"] = str(source.parent / cell["model"])
        cell["simulate"] = simulate
        path = tmp_path / "cell.yaml"
        path.write_text(yaml.safe_dump(cell))
        return path

    return write


@pytest.fixture
def start(request):
    """Starts `python -m sims run …` and returns (process, what its ready line says)."""
    started = []

    def begin(*arguments):
        process = subprocess.Popen(
            [sys.executable, "-m", "sims", "run", *map(str, arguments)],
            cwd=request.config.rootpath,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        assert select.select([process.stdout], [], [], PATIENCE_S)[0], "the simulator does not get ready"
        return process, json.loads(process.stdout.readline())

    yield begin
    for process in started:
        process.terminate()  # so that it removes its time file
        process.communicate(timeout=PATIENCE_S)


def run(request, *arguments):
    return subprocess.run(
        [sys.executable, "-m", "sims", *map(str, arguments)],
        cwd=request.config.rootpath,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_well_and_nothing_is_left_behind(start, probe_cell, signum):
    process, ready = start(probe_cell())
    time_file = Path(ready["time"]["source"].removeprefix("file:"))
    assert time_file.stat().st_size == 8
    process.send_signal(signum)
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, errors) == (0, "")
    assert not time_file.parent.exists()


def test_shutdown_ends_it(start, probe_cell):
    process, ready = start(probe_cell())
    host, port = ready["control"].split(":")
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as stream:
        stream.sendall(b'{"op": "shutdown"}\n')
        assert json.loads(stream.makefile().readline()) == {"ok": True}
    assert process.wait(PATIENCE_S) == 0


def test_the_ready_tells_addresses_that_can_be_opened_and_a_time_that_can_be_read(start, probe_cell):
    process, ready = start(probe_cell(), "--seed", 7)
    scheme, rest = ready["probe"].split("://")
    path, query = rest.split("?")
    assert (scheme, query) == ("contact+serial", "baud=250000")
    os.close(os.open(path, os.O_RDWR | os.O_NOCTTY))
    assert (ready["time"]["mode"], ready["seed"], ready["pid"]) == ("lockstep", 7, process.pid)
    assert reader_of(ready["time"]["source"])() >= 0


def test_the_shipped_cell_gets_places_where_its_simulators_listen(start, request):
    cell = request.config.rootpath / "procedures/cells/sphere_cell.yaml"
    _, ready = start(cell, "--clock", "realtime")
    written = yaml.safe_load(cell.read_text())
    robot, probe = urlsplit(ready["robot"]), urlsplit(ready["probe"])
    assert (robot.scheme, robot.netloc) == ("kuka+rsi", "127.0.0.1:0")
    query, expected = dict(parse_qsl(robot.query)), dict(parse_qsl(urlsplit(written["devices"]["robot"]).query))
    host, port = query["eki"].split(":")
    assert query | {"eki": ""} == expected | {"eki": "", "controller": "127.0.0.1"}
    socket.create_connection((host, int(port)), timeout=PATIENCE_S).close()
    assert probe.query == urlsplit(written["devices"]["probe"]).query
    assert Path(probe.path).is_char_device()


def test_a_wrong_ethernet_configuration_is_one_block_and_exit_code_2(request, tmp_path):
    source = request.config.rootpath / "procedures/cells/sphere_cell.yaml"
    cell = yaml.safe_load(source.read_text())
    cell["model"] = str(source.parent / cell["model"])
    (tmp_path / "rsi_ethernet.xml").write_text("<ROOT>")
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(cell))
    done = run(request, "run", path)
    assert done.returncode == 2
    assert "robot: " in done.stderr
    assert "rsi_ethernet.xml" in done.stderr
    assert "Traceback" not in done.stderr


def test_command_line_wins_over_the_cell_file(start, probe_cell):
    _, ready = start(probe_cell(seed=3, clock="lockstep"), "--clock", "realtime")
    assert (ready["seed"], ready["time"]["mode"]) == (3, "realtime")
    read = reader_of(ready["time"]["source"])
    assert 0 < read() < PATIENCE_S * 1e9


def test_a_ready_file_is_whole_when_it_appears(start, probe_cell, tmp_path, request):
    target = tmp_path / "ready.json"
    process = subprocess.Popen(
        [sys.executable, "-m", "sims", "run", str(probe_cell()), "--ready", str(target)],
        cwd=request.config.rootpath,
        stdout=subprocess.PIPE,
    )
    try:
        while not target.exists() and process.poll() is None:
            select.select([process.stdout], [], [], 0.01)
        assert json.loads(target.read_text())["pid"] == process.pid
        assert [path.name for path in tmp_path.glob("*ready*")] == ["ready.json"]
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


def test_it_ends_with_its_parent_however_that_one_ends(start, probe_cell):
    parent = subprocess.Popen(["sleep", "600"])
    process, _ = start(probe_cell(), "--parent", parent.pid)
    parent.kill()  # and is not waited for: a zombie is gone too
    assert process.wait(PATIENCE_S) == 0
    parent.wait()


def test_a_parent_that_is_gone_already_ends_it_too(start, probe_cell):
    parent = subprocess.Popen(["true"])
    parent.wait()
    process, _ = start(probe_cell(), "--parent", parent.pid)
    assert process.wait(PATIENCE_S) == 0


def test_all_errors_of_a_cell_file_are_one_block_and_exit_code_2(request, probe_cell):
    path = probe_cell(clock="never", faults=[{"fault": "probe.sulks"}])
    done = run(request, "run", path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"{path}: ")
    assert "simulate.clock" in done.stderr
    assert "simulate.faults[0]" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_device_without_simulator_is_named(request, probe_cell):
    path = probe_cell()
    path.write_text(path.read_text().replace("devices:\n", "devices:\n  hand: gripper+serial:///dev/ttyUSB0\n"))
    done = run(request, "run", path)
    assert done.returncode == 2
    assert "hand: there is no simulator for 'gripper+serial'" in done.stderr


@pytest.mark.parametrize("arguments", [["run", "nowhere.yaml"], ["run"], ["run", "x", "--seed", "-1"], ["dance"], []])
def test_a_wrong_call_is_exit_code_2_without_traceback(request, arguments):
    done = run(request, *arguments)
    assert done.returncode == 2
    assert done.stderr
    assert "Traceback" not in done.stderr
