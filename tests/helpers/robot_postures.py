"""Postures of the shipped robot, as the shipped cell file has them."""

from pathlib import Path

from cellctl.files import load_yaml
from cellctl.formats import RobotFile, postures_of
from cellctl.planning import RobotPostures

_PROCEDURES = Path(__file__).parents[2] / "procedures"
_FOUND = postures_of(
    load_yaml(_PROCEDURES / "cells" / "sphere_cell.yaml"),
    RobotFile.load(_PROCEDURES / "robots" / "kr5_r1400.yaml"),
    "touch",
)
KR5 = RobotPostures(tuple(_FOUND.home), tuple(map(tuple, _FOUND.touch)))
