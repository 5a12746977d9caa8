"""A simulator of another package: found by its entry point, with its settings, faults, events and requests."""

import json
import os
import select
import socket
import subprocess
import sys

import pytest
import yaml

from sims.simulator import FaultKind, Setting, Simulator
from sims.simulators import BadSimulator, Simulators

PATIENCE_S = 90

TRACKER = '''
from sims.simulator import FaultKind, FOR_MS, Setting
from sims.simulator import Simulator, with_path

class Server:
    """Says how often it has measured; its fault is active from the second measurement on."""

    def __init__(self, setup):
        self.setup = setup
        self.address = with_path(setup.address, "/here/" + str(setup.settings["noise_mm"]))
        self.requests = {"measure": self.measure}

    def measure(self, message):
        tcp = self.setup.scene.tcp()
        assert len(tcp) == 3 and self.setup.scene.blocked(tcp, tcp) in (True, False)
        self.setup.faults.announce("laser.measure")

    def close(self):
        pass

SIMULATOR = Simulator(
    schemes=("invented",),
    start=Server,
    section="laser",
    settings=(Setting("noise_mm", "number", 0.01, 0.0),),
    faults=(FaultKind("laser.blind", "no target is found", (FOR_MS,)),),
    events={"laser.measure": "a measurement begins"},
    most=2,
)
'''


@pytest.fixture
def run(request, tmp_path):
    """Runs `python -P -m sims` with the invented package installed, on a cell with `devices` and `simulate`."""
    package = tmp_path / "packages"
    (package / "invented-1.dist-info").mkdir(parents=True)
    (package / "invented-1.dist-info/METADATA").write_text("Metadata-Version: 2.1\nName: invented\nVersion: 1\n")
    entry = "[cellctl.simulators]\ninvented = invented_tracker:SIMULATOR\n"
    (package / "invented-1.dist-info/entry_points.txt").write_text(entry)
    (package / "invented_tracker.py").write_text(TRACKER)
    shipped = request.config.rootpath / "procedures/cells/sphere_cell.yaml"
    processes = []

    def begin(verb, devices, **simulate):
        cell = yaml.safe_load(shipped.read_text())
        cell["model"] = str(shipped.parent / cell["model"])
        cell["devices"] = devices
        cell["simulate"] = simulate
        (tmp_path / "cell.yaml").write_text(yaml.safe_dump(cell))
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "sims", verb, str(tmp_path / "cell.yaml")],
            env={**os.environ, "PYTHONPATH": str(package)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield begin
    for process in processes:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


def errors(run, devices, **simulate):
    return json.loads(run("check", devices, **simulate).communicate(timeout=PATIENCE_S)[0])


def test_it_runs_with_its_settings_event_fault_and_request(run):
    fault = {"fault": "laser.blind", "event": "laser.measure", "count": 2}
    process = run("run", {"laser": "invented://a?b=1"}, laser={"noise_mm": 0.5}, faults=[fault], clock="realtime")
    assert select.select([process.stdout], [], [], PATIENCE_S)[0]
    ready = json.loads(process.stdout.readline())
    assert ready["laser"] == "invented:///here/0.5?b=1"
    host, port = ready["control"].split(":")
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as stream:
        lines = stream.makefile("rw")

        def ask(**message):
            lines.write(json.dumps(message) + "\n")
            lines.flush()
            return json.loads(lines.readline())

        assert ask(op="measure", device="laser") == {"ok": True}
        assert "devices that have it: laser" in ask(op="measure", device="robot")["error"]
        again = ask(op="fault", fault="laser.blind", event="laser.measure", count=1)
        assert "laser.measure 1 has begun already" in again["error"]
        assert ask(op="fault", fault="laser.blind", event="laser.measure", count=5) == {"ok": True}
        assert ask(op="status")["events"] == {"laser.measure": 1}


def test_check_knows_its_section_and_its_faults(run):
    fault = {"fault": "laser.deaf"}
    found = errors(run, {"laser": "invented://a"}, laser={"noise_mm": -1, "colour": "red"}, faults=[fault])
    assert [text.split(":")[0] for text in found] == [
        "simulate.laser.colour", "simulate.laser.noise_mm", "simulate.faults[0]",
    ]  # fmt: skip
    assert "laser.blind" in found[2]


def test_an_event_that_no_device_of_the_cell_has_is_named_with_those_that_there_are(run):
    fault = {"fault": "laser.blind", "event": "probe.arm"}
    (found,) = errors(run, {"laser": "invented://a"}, faults=[fault])
    assert found.startswith("simulate.faults[0]: ")
    assert "'probe.arm'; there are laser.measure" in found


def test_how_many_of_a_kind_there_can_be_is_reported_by_the_description(run):
    two = {"laser": "invented://a", "second": "invented://b"}
    assert errors(run, two) == []
    (found,) = errors(run, {**two, "third": "invented://c"})
    assert "only 2 devices of invented can be simulated" in found


def test_a_device_that_nobody_simulates_is_an_error_at_check(run):
    (found,) = errors(run, {"laser": "invented://a", "hand": "gripper://b"})
    assert "there is no simulator for 'gripper', only for canopen" in found
    assert " and invented and kuka+rsi" in found


def test_a_package_that_cannot_be_loaded_is_named(run, tmp_path):
    (tmp_path / "packages/invented_tracker.py").write_text("import nothing_of_that_name\n")
    (found,) = errors(run, {"laser": "invented://a"})
    assert "the simulator 'invented' (invented_tracker:SIMULATOR) cannot be loaded" in found


@pytest.mark.parametrize(
    ("second", "what"),
    [
        (Simulator(schemes=("a",), start=print), "scheme 'a'"),
        (Simulator(schemes=("b",), start=print, section="own"), "section 'own'"),
        (Simulator(schemes=("b",), start=print, section="seed"), "section 'seed'"),
        (Simulator(schemes=("b",), start=print, faults=(FaultKind("tip.jump", ""),)), r"fault 'tip\.jump'"),
    ],
)
def test_two_simulators_cannot_share_a_name(second, what):
    first = Simulator(schemes=("a",), start=print, section="own", settings=(Setting("x", "number"),))
    with pytest.raises(BadSimulator, match=what):
        Simulators([first, second])
