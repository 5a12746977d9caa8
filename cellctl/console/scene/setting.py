"""The robot and the cell of a run, as its journal holds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.files import Document, InputError, parse_yaml
from cellctl.formats import Artefact, RobotFile, artefact_of
from cellctl.formats.cell_sections import FlangeReflector, Nest, Station, floor_of, reflectors_of, station_of
from cellctl.journal.events import RunStarted, SourceFile
from cellctl.kinematics import Floats, JointMap, SerialChain


@final
@dataclass(frozen=True, eq=False)
class Setting:
    """Robot and cell files of a run. chain: the nominal robot, its base as origin.

    artefact, station: None if the cell file has none. floor_mm: height of the floor in the base frame; None if not
    stated. home (n,): readings, deg; empty if not stated. problems: what could not be read, as text.
    """

    chain: SerialChain | None = None
    joints: JointMap | None = None
    robot: str = ""
    artefact: Artefact | None = None
    station: Station | None = None
    reflectors: tuple[FlangeReflector, ...] = ()
    floor_mm: float | None = None
    home: tuple[float, ...] = ()
    problems: tuple[str, ...] = ()

    @classmethod
    def of(cls, started: RunStarted | None) -> Setting:
        """The setting of a run; empty before its start. Its texts are read once."""
        if started is None:
            return cls(problems=("The run has not begun.",))
        return _read(_key(started.robot), _key(started.cell))

    @property
    def nests(self) -> Sequence[Nest]:
        """The monument nests of the cell file."""
        return self.station.nests if self.station else ()

    def flange(self, readings: ArrayLike) -> Floats:
        """Poses of the nominal flange (N, 4, 4) at readings (N, n), deg, in the robot's base frame, mm."""
        assert self.chain
        assert self.joints
        return self.chain.forward_flange(self.joints.model(np.asarray(readings, float)))

    def tcp(self, readings: ArrayLike) -> Floats:
        """Places of the nominal TCP (N, 3) at readings (N, n), deg, in the robot's base frame, mm."""
        assert self.chain
        return self._on_flange(readings, self.chain.tool[:3, 3])

    def reflector(self, name: str, readings: ArrayLike) -> Floats:
        """Places (N, 3) of the reflector called `name`, by the nominal robot, in its base frame, mm.

        The flange's own place if the cell file has no such reflector.
        """
        offset = next((one.xyz for one in self.reflectors if one.id == name), [0.0, 0.0, 0.0])
        return self._on_flange(readings, np.array(offset))

    def _on_flange(self, readings: ArrayLike, offset: Floats) -> Floats:
        flange = self.flange(readings)
        return np.asarray(flange[:, :3, 3] + flange[:, :3, :3] @ offset)


def _key(source: SourceFile | None) -> tuple[str, str] | None:
    return (source.path, source.text) if source else None


@lru_cache(maxsize=32)
def _read(robot: tuple[str, str] | None, cell: tuple[str, str] | None) -> Setting:
    problems: list[str] = []
    parts: dict[str, object] = {}
    for source, reader in ((robot, _robot), (cell, _cell)):
        try:
            parts |= reader(parse_yaml(source[1], source[0])) if source else {}
        except InputError as error:
            problems.append(str(error))
    if "chain" not in parts and not problems:
        problems.append("The journal holds no robot file: the robot is not shown.")
    return Setting(**parts, problems=tuple(problems))  # type: ignore[arg-type]


def _robot(document: Document) -> dict[str, object]:
    robot = RobotFile.from_document(document)
    return {"chain": robot.chain().with_base(np.eye(4)), "joints": robot.joint_map(), "robot": robot.name}


def _cell(document: Document) -> dict[str, object]:
    has = document.data if isinstance(document.data, dict) else {}
    postures = has.get("postures")
    home = postures.get("home", ()) if isinstance(postures, dict) else ()
    floor = floor_of(document)
    return {
        "artefact": artefact_of(document, ("artefact",)) if "artefact" in has else None,
        "station": station_of(document) if "station" in has else None,
        "reflectors": tuple(reflectors_of(document).on_flange) if "reflectors" in has else (),
        "floor_mm": float(floor.z) if floor else None,
        "home": tuple(float(value) for value in home),
    }
