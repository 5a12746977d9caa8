"""Which of several uploaded files is the data file, the table of positions, the robot file, the artefact."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Literal, TypeAlias

from cellctl.files import InputError, Problem

Role: TypeAlias = Literal["data", "positions", "robot", "artefact"]

_YAML = (".yaml", ".yml")
URDF_SUFFIX = ".urdf"
_ROBOT = re.compile(r"^(convention|joints|links|screws)\s*:", re.MULTILINE)
_JOINTS = re.compile(r"\b[AJq]_?1\b")
_CURE = "one data file, with it at most: a table of positions, a robot file, an artefact file"


def roles(heads: Mapping[str, str]) -> dict[Role, str]:
    """The file of each role; heads: the beginning of each file, by its name. Raises InputError for other sets."""
    found: dict[Role, str] = {}
    tables = [name for name in heads if not name.lower().endswith((*_YAML, URDF_SUFFIX))]
    for name in heads.keys() - set(tables):
        role: Role = "robot" if name.lower().endswith(URDF_SUFFIX) or _ROBOT.search(heads[name]) else "artefact"
        if role in found:
            raise InputError(Problem(name, 0, 0, f"there are two {role} files: {found[role]} too", _CURE))
        found[role] = name
    if not tables:
        raise InputError(Problem(", ".join(heads), 0, 0, "there is no data file", _CURE))
    if len(tables) > 2:
        raise InputError(Problem(", ".join(tables), 0, 0, "are more than two data files", _CURE))
    tables.sort(key=lambda name: _JOINTS.search(heads[name]) is None)
    found["data"] = tables[0]
    if len(tables) == 2:
        found["positions"] = tables[1]
    return found
