"""A model, targets, the shipped cell, and a controller of the test's own that keeps tables."""

import shutil
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.devices import ControllerTable, DeviceRefused, Identity, TableInfo, TableState
from cellctl.operations import table as table_module
from cellctl.operations.cell_devices import Connected
from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv

CELL = Path(__file__).parents[3] / "procedures" / "cells" / "sphere_cell.yaml"


class Controller:
    """Two tables in memory; `failing` is raised by a push, `tamper` changes what comes into force."""

    def __init__(self, serial="SIM-4711", simulated=True):
        self.name = "robot"
        self.identity = Identity("robot", serial, "KUKA KR5 R1400", "KSS", simulated)
        self.active: ControllerTable | None = None
        self.previous: ControllerTable | None = None
        self.failing: Exception | None = None
        self.tamper = lambda table: table
        self.connections = 0

    async def push_table(self, table):
        if self.failing:
            raise self.failing
        self.active, self.previous = self.tamper(table), self.active
        return await self.table_state()

    async def table_state(self):
        return TableState(*(self._info(table) for table in (self.active, self.previous)), None)

    async def read_table(self):
        return self.active

    async def rollback_table(self):
        if self.active is None and self.previous is None:
            raise DeviceRefused("robot", "there is no table to roll back to")
        self.active, self.previous = self.previous, self.active
        return await self.table_state()

    @staticmethod
    def _info(table):
        return TableInfo(table.id, len(table.rows), "89ABCDEF") if table else None


def run(*words):
    """The exit code of a command line."""
    return exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """A folder with a model, targets with and without postures, and a table for `SIM-4711`."""
    folder = tmp_path_factory.mktemp("made")
    readings = readings_near_the_middle(8)
    kr5_model().save(folder / "model.json")
    (folder / "targets.csv").write_text(targets_csv(readings))
    (folder / "bare.csv").write_text(targets_csv(readings, postures=False))
    files = (folder / "model.json", folder / "targets.csv", "--serial", "SIM-4711", "-o", folder / "table.json")
    assert run("compensate", *files) == 0
    return folder


@pytest.fixture
def folder(made, tmp_path, monkeypatch):
    """`model.json` and `targets.csv`: eight targets with postures near by."""
    for name in ("model.json", "targets.csv", "bare.csv"):
        shutil.copy(made / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def cellctl(folder):
    """Runs the command line in the folder of the files; the exit code."""
    return run


@pytest.fixture
def controller(monkeypatch):
    """The controller that the table commands find in the shipped cell instead of a simulator."""
    found = Controller()

    @asynccontextmanager
    async def instead(cell, drivers, names, **settings):
        found.connections += 1
        yield {name: Connected(found, found.identity) for name in names}

    monkeypatch.setattr(table_module, "connected", instead)
    return found


@pytest.fixture
def table(made, folder):
    """A table for `SIM-4711`."""
    return Path(shutil.copy(made / "table.json", folder))
