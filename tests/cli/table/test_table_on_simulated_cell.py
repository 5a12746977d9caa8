"""`cellctl table` through driver, wire and simulated controller, each command a connection (and a controller) anew."""

import json
import shutil
import subprocess
import sys
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import TableFile
from cellctl.operations import cell_devices
from cellctl.operations import table as table_module
from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv
from tests.helpers.runs import CELL, PATIENCE_S


def run(*words):
    return exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


@dataclass
class Cell:
    """The shipped cell with a memory, and two tables for its controller."""

    folder: Path
    serial: str

    @property
    def first(self):
        return self.folder / "first.json"

    @property
    def second(self):
        return self.folder / "second.json"

    def table(self, *words, json_=None):
        more = ["--json", self.folder / json_] if json_ else []
        runs = [] if words[0] == "verify" else ["--runs", self.folder / "runs"]
        return run("table", *words, "--cell", CELL, "--state", self.folder / "memory.json", *runs, *more)

    def active(self):
        assert self.table("show", json_="state.json") == 0
        state = json.loads((self.folder / "state.json").read_text())
        return state["active"] and state["active"]["id"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A cell with tables of 30 and 12 rows, the second in force."""
    folder = tmp_path_factory.mktemp("tables")
    kr5_model().save(folder / "model.json")
    assert run("table", "show", "--cell", CELL, "--json", folder / "who.json") == 0
    found = Cell(folder, json.loads((folder / "who.json").read_text())["serial"])
    for path, count in ((found.first, 30), (found.second, 12)):
        targets = folder / "targets.csv"
        targets.write_text(targets_csv(readings_near_the_middle(count)))
        assert run("compensate", folder / "model.json", targets, "--serial", found.serial, "-o", path) == 0
    assert found.table("push", found.second) == 0
    return found


@pytest.fixture
def cell(made, tmp_path):
    folder = tmp_path / "cell"
    shutil.copytree(made.folder, folder)
    return Cell(folder, made.serial)


@pytest.mark.long
def test_a_pushed_table_outlives_the_command_and_the_one_before_comes_back_by_rollback(cell):
    assert cell.serial.startswith("SIM-")
    assert cell.table("verify", cell.second) == 0
    assert cell.table("push", cell.first) == 0
    assert cell.table("verify", cell.first) == 0
    assert cell.table("verify", cell.second) == 1
    assert cell.table("rollback") == 0
    assert cell.active() == TableFile.load(cell.second).id


def test_another_simulated_robots_table_is_refused_and_the_old_one_stays(cell, capsys):
    content = TableFile.load(cell.first)
    other = content.model_copy(update={"robot": content.robot.model_copy(update={"serial": "SIM-000001"})})
    other.model_copy(update={"id": other.content_id()}).save(cell.first)
    assert cell.table("push", cell.first) == 2
    assert f"'SIM-000001', this one is '{cell.serial}'" in capsys.readouterr().err
    assert cell.active() == TableFile.load(cell.second).id


@pytest.mark.long
@pytest.mark.parametrize("after_ms", [5, 45, 85, 125])
def test_a_controller_that_restarts_during_a_push_has_the_table_that_the_end_of_the_command_tells(
    cell, capsys, monkeypatch, after_ms
):
    monkeypatch.setattr(table_module, "connected", restarting(monkeypatch, after_ms))
    code = cell.table("push", cell.first)
    said = capsys.readouterr().err
    monkeypatch.undo()
    first, second = (TableFile.load(path).id for path in (cell.first, cell.second))
    if code == 0 or (code == 3 and f"{first[:12]} is in force" in said):
        assert cell.active() == first
    elif code == 3:
        assert cell.active() == second
    else:
        assert code == 4
        assert cell.active() in (first, second)
    assert code == 3 or after_ms > 5
    assert cell.table("history", json_="history.json") == 0  # the record says the same as the controller
    [found] = json.loads((cell.folder / "history.json").read_text())["controllers"]
    assert (found["changes"][0]["state"] == "uncertain") == (code == 4)


def restarting(monkeypatch, after_ms):
    """`connected`, and then the controller restarts after `after_ms` of the cell's time."""
    started = []
    start = cell_devices.SimulatedCell.start

    async def noted(*arguments):
        started.append(await start(*arguments))
        return started[-1]

    monkeypatch.setattr(cell_devices.SimulatedCell, "start", noted)

    @asynccontextmanager
    async def instead(*arguments, **settings):
        async with cell_devices.connected(*arguments, **settings) as devices:
            now_ms = (await started[-1].tell({"op": "status"}))["time_ns"] * 1e-6
            await started[-1].tell({"op": "fault", "fault": "robot.restart", "at_ms": now_ms + after_ms})
            yield devices

    return instead


SIGNALLED = """
import asyncio, os, signal, sys
from cellctl.operations import cell_devices as connected
opened = connected.open_devices

def signalled(device):
    connect, close = device.connect, device.close

    async def connect_and_wait():
        await connect()
        os.kill(os.getpid(), signal.{0})
        await asyncio.sleep(600)

    async def close_and_say():
        await close()
        print(f"{{device.name}} closed", flush=True)

    device.connect, device.close = connect_and_wait, close_and_say
    return device

connected.open_devices = lambda *given: {{name: signalled(device) for name, device in opened(*given).items()}}
from cellctl.cli.main import main
main()
"""


@pytest.mark.long
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_verb_that_is_ended_by_a_signal_closes_its_devices_and_ends_with_130(name):
    program = [sys.executable, "-c", SIGNALLED.format(name), "table", "show", "--cell", str(CELL)]
    ended = subprocess.run(program, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert (ended.returncode, ended.stdout) == (130, "robot closed\n")
    assert ended.stderr == "cellctl: aborted by the operator\n"
