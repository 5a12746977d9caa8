"""Writes the cell file of a robot of the library: addresses to fill in, places that its reach allows, simulators."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import final

from cellctl.clock import WallClock
from cellctl.devices.cell import Cell, reach_of
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem, write_atomically
from cellctl.installed import checks_of, shipped
from cellctl.operations.campaign import load_campaign
from cellctl.operations.cell_devices import as_loaded
from cellctl.operations.robot_library import LibraryRobot, reach_mm

_PROBE_MM, _SHORTER_BELOW_MM = (60.0, 40.0, 240.0), 1000.0
"""The probe's tip in the flange frame, held askew, so that a turn of the last joint moves it; of robots with a smaller
reach than that in proportion."""

_SPHERES = {"S1": (0.64, -0.24, -0.10), "S2": (0.64, 0.24, -0.10), "S3": (0.77, 0.0, 0.0), "P1": (0.57, 0.0, 0.10)}
"""Centres as shares of the reach, from axis 1 at the height of joint 2: those of the shipped KR5 cell."""

_STEM_MM = 200.0
"""From the lowest centres down to the plate: the wrist is 120 mm thick, and touches come from below the equator too."""

_SCALES = (1.0, 0.85, 0.7, 0.65)
"""Of these places, in the order tried: forearm and wrist are as thick for a small robot as for a large one."""


@final
@dataclass(frozen=True, slots=True)
class _Maker:
    """What is common to a maker's six-axis robots: joint readings in degrees, and lines of the cell file.

    scheme: of its driver. floor_is_plate: as below an arm on a table; otherwise the floor is at the robot's foot.
    """

    scheme: str
    home: tuple[int, ...]
    touch: tuple[tuple[int, ...], ...]
    turn: tuple[int, ...]
    floor_is_plate: bool = False

    def address(self, stem: str) -> str:
        """Of the controller, with its network as an example."""
        if self.scheme == "ur+rtde":
            return "ur+rtde://192.168.56.101?contact_input=0"
        ethernet = f"ethernet={stem}_rsi_ethernet.xml&eki=172.31.1.147:54600&controller=192.168.10.1"
        return f"kuka+rsi://192.168.10.2:49152?{ethernet}"

    def limits(self, tcp_reach_mm: float | None) -> str:
        """Of a search: just enough for 10 mm/s at the TCP, and below the driver's ceiling of 250 mm/s."""
        ceiling = 0.95 * math.degrees(250.0 / (tcp_reach_mm * math.sqrt(3.0))) if tcp_reach_mm else 2.0
        speed = math.floor(100.0 * min(2.5, ceiling)) / 100.0
        acceleration = math.floor(10.0 * min(20.0, 10.0 * speed)) / 10.0
        common = f"speed_deg_s: {speed:g}, acceleration_deg_s2: {acceleration:g}, travel_deg: 5"
        if self.scheme == "ur+rtde":
            return f"{{speed_percent: 50, {common}}}"
        return f"{{correction_deg: 5, {common}, jerk_deg_s3: {math.floor(min(400.0, 20.0 * acceleration)):g}}}"


_MAKERS = {
    "KUKA": _Maker(
        "kuka+rsi",
        (0, -90, 90, 0, 45, 0),
        ((0, -60, 90, 0, 60, 0), (0, -60, 90, 120, -60, 0), (0, -60, 90, -120, -60, 0), (0, -45, 60, 60, 60, 0)),
        (-47, -76, 106, 4, 90, 89),
    ),
    "Universal Robots": _Maker(
        "ur+rtde",
        (180, -100, 60, -50, -90, 0),
        (
            (180, -70, 100, -120, -90, 0),
            (180, -70, 100, -120, -90, 120),
            (180, -70, 100, -120, -90, -120),
            (180, -60, 80, -110, -60, 60),
            (180, -60, 80, -110, -120, -60),
        ),
        (228, -71, 84, -149, -96, -8),
        floor_is_plate=True,
    ),
}
"""Makers whose six-axis robots a driver can move; postures are those of the shipped cells."""


@final
@dataclass(frozen=True, slots=True)
class MadeCell:
    """The files that were written, the cell file first; the procedures that were checked with it; its devices."""

    files: tuple[Path, ...]
    procedures: tuple[str, ...]
    devices: tuple[str, ...]


def make_cell(name: str, out: Path, *, probe: bool, tracker: bool, plc: bool) -> MadeCell:
    """Write the cell file `out` for the robot `name` of the library, with what it needs beside it, and check it.

    Raises InputError if there is no such robot, no driver moves it, a file exists, or the check finds errors.
    """
    found = LibraryRobot.find(name)
    maker = _MAKERS.get(found.source.maker)
    if maker is None or found.robot.n != 6:
        what = (
            f"no driver moves the {found.robot.name}: there are drivers for six-axis robots of {' and '.join(_MAKERS)}"
        )
        cure = "move it yourself and work with files: `cellctl plan`, `import`, `fit` (docs/howto/without-kuka.md)"
        raise InputError(Problem(name, 0, 0, what, cure))
    texts = dict(_texts(found, maker, out, _SCALES[0], probe=probe, tracker=tracker, plc=plc))
    programs = out.with_name(f"{out.stem}_programs")
    if existing := [path for path in (*texts, programs) if path.exists()]:
        raise InputError(Problem(str(existing[0]), 0, 0, "exists already", "give -o another name, or move it away"))
    for path, text in texts.items():
        write_atomically(path, text)
    drivers = DriverRegistry()
    cell = Cell.load(out, drivers)
    files = [out, *(path for path in texts if path != out)]
    if maker.scheme == "ur+rtde":  # the simulated controller executes the program that a real one loads
        programs.mkdir()
        made = drivers.controller_files(cell.name, cell.addresses["robot"], cell.surroundings("robot", WallClock()))
        for file, text in (made or {}).items():
            (programs / file).write_bytes(as_loaded(file, text))
        files.append(programs)
    procedures = checks_of(cell.addresses)
    for scale in _SCALES:
        write_atomically(out, dict(_texts(found, maker, out, scale, probe=probe, tracker=tracker, plc=plc))[out])
        try:
            for procedure in procedures:
                load_campaign(shipped("procedure")[procedure], out, [])
            break
        except InputError:
            if scale == _SCALES[-1] or not probe:
                raise
    return MadeCell(tuple(files), procedures, tuple(cell.addresses))


def _texts(
    found: LibraryRobot, maker: _Maker, out: Path, scale: float, *, probe: bool, tracker: bool, plc: bool
) -> Iterator[tuple[Path, str]]:
    """The robot file, where the library's has no tool, the Ethernet configuration of KUKA, and the cell file."""
    model, tcp_reach = found.name, reach_of(found.file)
    if probe and not any(found.robot.tool.xyz):
        own = out.with_name(f"{out.stem}_robot.yaml")
        share = min(1.0, reach_mm(found.robot) / _SHORTER_BELOW_MM)
        tip = ", ".join(f"{share * each:.0f}" for each in _PROBE_MM)
        tool = f"tool: {{xyz: [{tip}], abc: [35, 30, 0]}}   # FILL IN: probe tip in the flange frame, as measured"
        text = re.sub(r"^tool: .*$", tool, found.file.read_text(encoding="utf-8"), flags=re.MULTILINE)
        model, tcp_reach = own.name, (tcp_reach or 0.0) + math.hypot(*_PROBE_MM)
        yield own, text
    if maker.scheme == "kuka+rsi":
        shipped_one = shipped("cell")["sphere_cell"].with_name("rsi_ethernet.xml")
        yield out.with_name(f"{out.stem}_rsi_ethernet.xml"), shipped_one.read_text(encoding="utf-8")
    parts = [_head(found, maker, out.stem, model, tcp_reach, probe=probe, tracker=tracker, plc=plc)]
    places = _places(found, scale)
    if probe:
        parts.append(_artefact(places))
    if tracker:
        parts.append(_station(places if maker.floor_is_plate else {}))
    parts.append(_postures(maker, probe=probe, tracker=tracker))
    parts.append(_simulate(found, maker, out.stem))
    yield out, "\n".join(parts)


def _places(found: LibraryRobot, scale: float) -> Mapping[str, tuple[float, float, float]]:
    """Sphere → centre, mm, base frame; `plate` → a point of it."""
    reach, joint_2 = reach_mm(found.robot) * scale, found.robot.links[0].d
    places = {
        name: (round(x * reach, -1), round(y * reach, -1), round(joint_2 + z * reach, -1))
        for name, (x, y, z) in _SPHERES.items()
    }
    return {**places, "plate": (0.0, 0.0, min(z for _, _, z in places.values()) - _STEM_MM)}


def _head(
    found: LibraryRobot,
    maker: _Maker,
    stem: str,
    model: str,
    tcp_reach_mm: float | None,
    *,
    probe: bool,
    tracker: bool,
    plc: bool,
) -> str:
    address = maker.address(stem)
    if not probe:
        address = address.replace("?contact_input=0", "")
    devices = [f"  robot: {address}"]
    devices += ["  probe: contact+serial:///dev/ttyACM0?baud=250000"] if probe else []
    devices += ["  tracker: geocom+serial:///dev/ttyUSB0?baud=115200&accuracy=tdra6000"] if tracker else []
    devices += ["  plc: modbus+tcp://192.168.10.5:502?unit=1"] if plc else []
    lines = [
        f"# Cell of one {found.robot.name}, written by `cellctl cell`. It runs on simulators as it is.",
        "# On a real cell, replace what FILL IN marks, delete `simulate:`, and check it with `cellctl check`.",
        f"name: {found.name} cell",
        f"model: {model}",
        "",
        "devices:                  # FILL IN: addresses",
        *devices,
        "",
        "limits:                   # of a search: low, and just enough for 10 mm/s at the TCP",
        f"  robot: {maker.limits(tcp_reach_mm)}",
        "",
    ]
    return "\n".join(lines)


def _artefact(places: Mapping[str, tuple[float, float, float]]) -> str:
    pairs = combinations([name for name in _SPHERES if name != "P1"], 2)
    spheres = [
        f"    - {{id: {name}, diameter: 61.4, centre: [{', '.join(f'{each:g}' for each in places[name])}]}}"
        for name in _SPHERES
    ]
    distances = [
        f"    - {{between: [{a}, {b}], mm: {math.dist(places[a], places[b]):.3f}, sigma: 0.01}}" for a, b in pairs
    ]
    lines = [
        "artefact:                 # FILL IN: diameters; centres in the robot's base frame, within some millimetres",
        "  tip_radius: 0.6",
        f"  plate: {{z: {places['plate'][2]:g}, stem_radius: 8}}",
        "  spheres:                # P1 is the proof: no fit sees it, and its place is not certified",
        *spheres,
        "  distances:              # FILL IN: certified, or leave out",
        *distances,
        "",
    ]
    return "\n".join(lines)


def _station(below: Mapping[str, tuple[float, float, float]]) -> str:
    floor = below["plate"][2] if below else 0.0
    return f"""\
station:                  # FILL IN: rough place of the instrument in the robot's base frame, mm and degrees
  xyz: [3400, -1200, 900]
  abc: [150, 0, 0]
  search_mm: 30
  nests:                  # FILL IN: monuments, fixed to the floor, apart from the robot
    - {{id: N1, xyz: [600, -1500, 400]}}
    - {{id: N2, xyz: [1900, 1400, 300]}}
    - {{id: N3, xyz: [2900, 900, 1500]}}
    - {{id: N4, xyz: [6200, -900, 1400]}}
  distances:              # FILL IN: certified, or leave out
    - {{between: [N1, N4], mm: 5720.140, sigma: 0.03}}

reflectors:               # FILL IN: places in the flange frame, mm
  constant_mm: 0.0
  centring_mm: 0.01
  acceptance_deg: 30
  on_flange:
    - {{id: R1, xyz: [120, 0, 80], facing: [1, 0, 0]}}
    - {{id: R2, xyz: [120, 130, 0], facing: [1, 0, 0]}}
    - {{id: R3, xyz: [120, -130, 0], facing: [1, 0, 0]}}

floor: {{z: {floor:g}, clearance_mm: 150}}

load: {{name: probe and reflectors, mass: 0, xyz: [0, 0, 0], absolute_accuracy: false}}   # FILL IN
"""


def _postures(maker: _Maker, *, probe: bool, tracker: bool) -> str:
    lines = [
        "postures:                 # FILL IN: joint readings of this robot in this cell, degrees",
        f"  home: {list(maker.home)}      # clear of everything: where a campaign begins and ends",
    ]
    if probe:
        lines += [
            "  touch:                  # from which the planner looks for touches, the first joint turned towards the"
        ]
        lines += ["                          # sphere", *(f"    - {list(posture)}" for posture in maker.touch)]
    if tracker:
        lines += [f"  turn: {list(maker.turn)}  # from which single axes are turned: the reflector stays visible"]
    return "\n".join([*lines, ""])


def _simulate(found: LibraryRobot, maker: _Maker, stem: str) -> str:
    lines = ["simulate:", "  seed: 1", "  clock: lockstep"]
    if maker.scheme == "ur+rtde":
        series = "e" if found.name.endswith("e") or "e_" in found.name else "cb3"
        lines += [f"  ur: {{series: {series}, probe_input: 0, programs: {stem}_programs, program: cellctl.urp}}"]
    return "\n".join([*lines, ""])
