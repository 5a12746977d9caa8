"""docs/reference/simulated-behaviour.md: each behaviour of a simulator has a row with its source and its test.

What a simulator handles is enumerated from the simulators themselves: settings, faults, constants, enumerations, and
the registries of commands, tags, variables, procedures, functions and objects.
"""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from sims.bench import catalogue, setup_of
from sims.cell import read_cell
from sims.drives._drive import objects_of
from sims.faults import Faults
from sims.geocom._configuration import Configuration
from sims.geocom._measuring_rpcs import measuring_procedures
from sims.geocom._motion import Aiming, motion_procedures
from sims.geocom._settings_rpcs import settings_procedures
from sims.kernel import Kernel
from sims.krc._eki_messages import OPERATIONS
from sims.krc._telegram import ATTRIBUTES, TYPES
from sims.plc._modbus import _FUNCTIONS
from sims.plc._server import PlcServer
from sims.simulator import Simulator
from sims.simulators import installed
from sims.ur._dashboard import Dashboard
from sims.ur._servers import start as ur_servers
from sims.varproxy._controller import start
from tests.helpers.runs import ROOT
from tests.helpers.station import Bench, Scene

PAGE = ROOT / "docs" / "reference" / "simulated-behaviour.md"
CELLS = ROOT / "procedures" / "cells"
DEVICES = {
    "KRC": "krc",
    "Variable proxy": "varproxy",
    "GeoCOM": "geocom",
    "PLC": "plc",
    "CANopen": "drives",
    "Universal Robots": "ur",
}
CERTAINTIES = ("sure", "likely", "assumed")
UNDOCUMENTED = re.compile(r"(ours|world|fault|assumption)\b")
"""Sources of what no document states: our own protocol, the simulated world, a fault that a cell file orders."""

NO_BEHAVIOUR = {
    "MS", "PEER", "ARCSEC", "UM_PER_M", "TURN", "HEARTBEAT", "SYNC", "JOB", "ROW", "READERS", "BOOLEANS",
    "ZERO", "NO_TOOL", "_BASE", "FOR_EVER_NS", "NO_FUNCTION", "_GOING_ON", "_CONNECTED",
}  # fmt: skip
"""Units, and names within a simulator."""


@dataclass(frozen=True)
class Row:
    """A behaviour. `names`: what it is of, as the simulator has them."""

    device: str
    module: str
    names: tuple[str, ...]
    behaviour: str
    source: str
    certainty: str
    test: str


def test_every_behaviour_that_can_be_enumerated_has_a_row_and_no_row_is_of_something_else() -> None:
    found = {device: _enumerated(device) for device in DEVICES.values()}
    named = {device: [name for row in ROWS if row.device == device for name in row.names] for device in found}
    assert {device: sorted(found[device] - set(named[device])) for device in found} == {device: [] for device in found}
    assert {device: sorted(set(named[device]) - found[device]) for device in found} == {device: [] for device in found}
    assert {device: [name for name in names if names.count(name) > 1] for device, names in named.items()} == {
        device: [] for device in found
    }


def test_the_row_of_a_setting_states_its_default() -> None:
    rows = {name: row for row in ROWS for name in row.names}
    missing = []
    for device in DEVICES.values():
        simulator = _simulator(device)
        for setting in simulator.settings:
            default = f"{setting.default:g}" if isinstance(setting.default, float) else str(setting.default)
            name = f"{simulator.section}.{setting.name}"
            if setting.default is not None and not re.search(rf"(?<![\w.]){default}(?![\w.])", rows[name].behaviour):
                missing.append(f"{name}: {default}")
    assert missing == []


def test_every_module_of_a_simulator_has_its_table() -> None:
    modules = {
        f"sims/{device}/{file.name}"
        for device in DEVICES.values()
        for file in (ROOT / "sims" / device).glob("*.py")
        if file.name != "__init__.py"
    }
    assert {row.module for row in ROWS} == modules


def test_every_row_states_source_certainty_and_a_test_that_exists() -> None:
    sources = set(re.findall(r"^\| \*\*(.+?)\*\* \|", TEXT, re.MULTILINE))
    wrong = []
    for row in ROWS:
        cited = re.findall(r"\[([^\]]+)\](?!\()", row.source)
        if not (UNDOCUMENTED.match(row.source) or cited) or set(cited) - sources:
            wrong.append(f"{row.module}: {row.behaviour}: no such source: {row.source}")
        if row.certainty not in CERTAINTIES or (row.source.startswith("assumption") and row.certainty != "assumed"):
            wrong.append(f"{row.module}: {row.behaviour}: certainty: {row.certainty}")
        if not all(map(_exists, _tests(row.test, row.device))):
            wrong.append(f"{row.module}: {row.behaviour}: no such test: {row.test}")
    assert wrong == []


def test_every_assumption_that_a_safety_rule_relies_on_has_its_experiment_and_its_tests() -> None:
    rows = list(_rows_of(TEXT.partition("## Assumptions")[2].partition("\n## ")[0]))
    assert len(rows) > 10
    for assumption, constant, rule, experiment, change, test in rows:
        assert all((assumption, rule, experiment, change)), assumption
        assert all(map(_exists, _tests(test, "krc"))), f"{assumption}: {test}"
        file, _, names = constant.replace("`", "").partition(" ")
        text = (ROOT / file).read_text(encoding="utf-8")
        assert names, f"{assumption}: {constant}"
        assert all(name in text for name in names.split(", ")), f"{assumption}: {constant}"


TEXT = PAGE.read_text(encoding="utf-8")


def _read() -> Iterator[Row]:
    for section in re.split(r"^## ", TEXT, flags=re.MULTILINE)[1:]:
        title = section.partition("\n")[0]
        for part in re.split(r"^### ", section, flags=re.MULTILINE)[1:] if title in DEVICES else ():
            module = part.partition("\n")[0].strip("`")
            for cells in _rows_of(part):
                names, *others = cells
                yield Row(DEVICES[title], module, tuple(_names(names)), *others)


def _rows_of(text: str) -> Iterator[list[str]]:
    """The cells of a table's rows, without its head."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    for line in lines[2:]:
        yield [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip("|"))]


def _names(cell: str) -> Iterator[str]:
    """`RPC 2008`, or a range, `RPC 9018…9021`."""
    for name in re.findall(r"`([^`]+)`", cell):
        span = re.fullmatch(r"(\w+) (\d+)…(\d+)", name)
        yield from (f"{span[1]} {n}" for n in range(int(span[2]), int(span[3]) + 1)) if span else (name,)


def _tests(cell: str, device: str) -> list[tuple[Path, str]]:
    """Files and functions: `test_plc_program.py::test_…` of this device's folder, or by its path in tests/."""
    found = re.findall(r"`([\w/]+\.py)::(\w+)`", cell)
    folder = ROOT / "tests"
    return [(folder / file if "/" in file else folder / "sims" / device / file, name) for file, name in found] or [
        (folder, cell)
    ]


def _exists(test: tuple[Path, str]) -> bool:
    file, name = test
    return file.is_file() and re.search(rf"^(async )?def {name}\(", file.read_text("utf-8"), re.MULTILINE) is not None


ROWS = tuple(_read())


def _enumerated(device: str) -> set[str]:
    return {*_declared(device), *_constants_and_enumerations(device), *_REGISTRIES[device]()}


def _declared(device: str) -> set[str]:
    """Settings, as `section.setting`, and faults."""
    simulator = _simulator(device)
    return {f"{simulator.section}.{setting.name}" for setting in simulator.settings} | {
        fault.name for fault in simulator.faults
    }


def _simulator(device: str) -> Simulator:
    simulator: Simulator = importlib.import_module(f"sims.{device}").SIMULATOR
    assert simulator in installed().all
    return simulator


def _constants_and_enumerations(device: str) -> Iterator[str]:
    for file in (ROOT / "sims" / device).glob("_[a-z]*.py"):
        module = importlib.import_module(f"sims.{device}.{file.stem}")
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef):
                kind = getattr(module, node.name)
                if issubclass(kind, Enum):
                    yield from (f"{node.name}.{member.name}" for member in kind)
            yield from (name for name in _assigned(node) if _is_constant(name, getattr(module, name)))


def _assigned(node: ast.stmt) -> Iterator[str]:
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    for target in targets:
        yield from (part.id for part in ast.walk(target) if isinstance(part, ast.Name))


def _is_constant(name: str, value: object) -> bool:
    plain = (int, float, str, bytes, tuple, dict, frozenset, set, range)
    return name.isupper() and name not in NO_BEHAVIOUR and isinstance(value, plain)


def _of_krc() -> set[str]:
    return {f"DEF_{tag}" for tag in ATTRIBUTES} | TYPES | OPERATIONS


def _of_varproxy() -> set[str]:
    kernel = Kernel("lockstep")
    setup = setup_of(read_cell(CELLS / "varproxy_cell.yaml"), "robot", kernel, Faults(kernel, catalogue()))
    controller = start(setup)
    try:
        return set(controller.variables._variables)
    finally:
        controller.close()
        kernel.close()


def _of_geocom() -> set[str]:
    kernel = Kernel("lockstep")
    instrument = Bench(kernel, Scene([])).station.instrument
    kernel.close()
    aiming = Aiming(instrument, lambda event: None)
    procedures = {
        **settings_procedures(instrument),
        **motion_procedures(instrument, aiming),
        **measuring_procedures(instrument, lambda event: None),
    }
    return {f"RPC {number}" for number in procedures} | set(Configuration.__dataclass_fields__)


def _of_plc() -> set[str]:
    kernel = Kernel("lockstep")
    cell = read_cell(CELLS / "tracker_cell.yaml")
    device = next(name for name, address in cell.addresses.items() if address.startswith("modbus+tcp"))
    server = PlcServer(setup_of(cell, device, kernel, Faults(kernel, catalogue())))
    tables = {
        "input": server.program.discrete_inputs(),
        "coil": server.program.coils(),
        "register": server.program.input_registers(),
        "holding": server.program.holding_registers(),
    }
    server.close()
    kernel.close()
    places = {f"{kind} {place}" for kind, table in tables.items() for place in range(len(table))}
    return places | {f"function {number}" for number in _FUNCTIONS}


def _of_drives() -> set[str]:
    return {f"0x{index:04X}" for index in objects_of(1, 1, 1, 1)}


def _of_ur() -> set[str]:
    """Fields of RTDE, registers without their numbers; commands of Dashboard; functions of URScript."""
    kernel = Kernel("lockstep")
    cell = read_cell(ROOT / "tests/sims/ur/ur10e_cell.yaml")
    servers = ur_servers(setup_of(cell, "robot", kernel, Faults(kernel, catalogue())))
    servers.close()
    kernel.close()
    fields = {*servers.rtde.outputs, *servers.rtde.inputs}
    commands = {f"command {name}" for name in Dashboard(servers.controller).commands}
    registers = {re.sub(r"(register)_\d+$", r"\1", name) for name in fields}
    return registers | commands | set(servers.controller.runtime.builtins)


_REGISTRIES = {
    "krc": _of_krc,
    "varproxy": _of_varproxy,
    "geocom": _of_geocom,
    "plc": _of_plc,
    "drives": _of_drives,
    "ur": _of_ur,
}
