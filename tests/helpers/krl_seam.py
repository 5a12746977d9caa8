"""A KUKA program and its data list as a pendant writes them, around the KR5 of `kr5_model`; for tests.

The points are computed here from joint readings by the nominal robot; bases and tools are those of `$config.dat`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cellctl.formats import RobotFile
from cellctl.kinematics import Floats, abc_from_rotation, inverse, inverse_pose, pose_from_xyz_abc
from cellctl.kinematics.controller_readings import status_of, turn_of
from tests.helpers.kr5_model import ROBOT

FILE = RobotFile.load(ROBOT)
CHAIN, JOINTS = FILE.chain(), FILE.joint_map()
TORCH = (*FILE.tool.xyz, *FILE.tool.abc)
TABLE = (900.0, -100.0, 200.0, 10.0, 5.0, -3.0)
BASE = pose_from_xyz_abc(TABLE[:3], TABLE[3:])
CORNER = np.array([-8.0, -55.0, 78.0, 14.0, 55.0, 25.0])
"""Readings of the first point, in the region of `kr5_model`."""


def config(torch: tuple[float, ...] = TORCH, table: tuple[float, ...] = TABLE) -> str:
    rows = {"TOOL_DATA[1]": torch, "TOOL_DATA[2]": (0.0, 0.0, 300.0, 0.0, 0.0, 0.0), "BASE_DATA[2]": table}
    lines = [f"{name}={{{components(values)}}}" for name, values in rows.items()]
    return "\r\n".join(["DEFDAT $CONFIG", "DECL FRAME TOOL_DATA[16]", "DECL FRAME BASE_DATA[32]", *lines, "ENDDAT", ""])


def components(values: tuple[float, ...] | Floats) -> str:
    return ",".join(f"{label} {value:.9f}" for label, value in zip("XYZABC", values, strict=True))


def readings_at(shift: tuple[float, float, float], start: Floats = CORNER) -> Floats:
    """Readings of the nominal robot with its tool moved by `shift`, mm, from where it is at `start`."""
    goal = CHAIN.forward(JOINTS.model(start))
    goal[:3, 3] += shift
    found = inverse(CHAIN, goal, JOINTS.model(start))
    assert found.converged
    return np.asarray(JOINTS.readings(found.q))


def position(readings: Floats, base: Floats = BASE) -> str:
    """`X …,Y …,Z …,A …,B …,C …,S …,T …` of the tool at `readings`, in `base`."""
    pose = inverse_pose(base) @ CHAIN.forward(JOINTS.model(readings))
    status, turn = int(status_of(CHAIN, JOINTS, readings)), int(turn_of(readings))
    return f"{components(np.array([*pose[:3, 3], *abc_from_rotation(pose[:3, :3])]))},S {status},T {turn}"


def joints(readings: Floats) -> str:
    return ",".join(f"A{axis} {value:.9f}" for axis, value in enumerate(readings, 1))


@dataclass
class Seam:
    """A program under construction. name: of the module."""

    name: str = "SEAM"
    src: list[str] = field(default_factory=list)
    dat: list[str] = field(default_factory=list)

    def point(self, name: str, value: str, tool: int = 1, base: int = 2, kind: str = "E6POS") -> None:
        external = ",".join(f"E{axis} 0.0" for axis in range(1, 7))
        self.dat += [
            f"DECL {kind} X{name}={{{value},{external}}}",
            f'DECL FDAT F{name}={{TOOL_NO {tool},BASE_NO {base},IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}}',
        ]

    def form(self, kind: str, *names: str, fdat: str | None = None) -> None:
        """An inline form; of a circle auxiliary and end point."""
        path = kind in ("LIN", "CIRC")
        self.src += [
            f";FOLD {kind} {' '.join(names)} Vel=2 m/s CPDAT1 Tool[1]:torch Base[2]:table;%{{PE}}%R 8.3.48",
            "LDAT_ACT=LCPDAT1" if path else "PDAT_ACT=PPDAT1",
            f"FDAT_ACT={fdat or f'F{names[-1]}'}",
            "BAS(#CP_PARAMS,2)" if path else "BAS(#PTP_PARAMS,100)",
            f"{kind} {', '.join(f'X{name}' for name in names)}",
            ";ENDFOLD",
        ]

    def write(self, folder: Path, end: str = "\r\n", *, finish: bool = True) -> None:
        """seam.src and seam.dat in Latin-1; finish: with END and a last line end."""
        head = ["&ACCESS RVP", f"DEF {self.name}( )", ";FOLD INI", "BAS(#INITMOV,0)", ";ENDFOLD"]
        src = end.join([*head, *self.src, *(["END", ""] if finish else [])])
        ldat = "DECL LDAT LCPDAT1={VEL 2.0,ACC 100.0,ORI_TYP #VAR,CIRC_TYP #BASE}"
        pdat = "DECL PDAT PPDAT1={VEL 100.0,ACC 100.0}"
        dat = end.join(["&ACCESS RVP", f"DEFDAT {self.name} PUBLIC", *self.dat, ldat, pdat, "ENDDAT", ""])
        (folder / "seam.src").write_bytes(src.encode("latin-1"))
        (folder / "seam.dat").write_bytes(dat.encode("latin-1"))
        (folder / "$config.dat").write_bytes(config().encode("latin-1"))


def usual_seam() -> Seam:
    """PTP, LIN, CIRC, LIN in the region of `kr5_model`."""
    seam = Seam()
    places = {
        "P1": (0, 0, 0),
        "P2": (-20, 150, -40),
        "P3": (-80, 190, -60),
        "P4": (-120, 130, -60),
        "P5": (-60, 20, 30),
    }
    for name, shift in places.items():
        seam.point(name, position(readings_at(shift)))
    seam.form("PTP", "P1")
    seam.form("LIN", "P2")
    seam.form("CIRC", "P3", "P4")
    seam.form("LIN", "P5")
    return seam
