"""Nominal robots: of the library, of a file, or made in the program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

from cellctl.facade.arrays import postures, refused
from cellctl.files import Document
from cellctl.formats import RobotFile

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A nominal robot. file: the content of its robot file; document: that file with its positions."""

    file: RobotFile
    document: Document

    @property
    def name(self) -> str:
        """Name in the robot file."""
        return self.file.name

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.file.n

    @property
    def limits(self) -> Floats:
        """Joint limits (n, 2), controller readings, deg: lower, upper."""
        return self.file.limits()

    def forward(self, q: ArrayLike) -> Floats:
        """Poses (N, 4, 4), mm, of the TCP at controller readings `q` (N, n), deg; (4, 4) for one posture (n,).

        Base and tool are those of the robot file. Raises InputError for another shape, and for values that are not
        finite.
        """
        import numpy as np

        readings = postures(q, self.n)
        found = self.file.chain().forward(self.file.joint_map().model(readings))
        return np.asarray(found[0] if np.ndim(q) == 1 else found)

    def __repr__(self) -> str:
        return f"<cellctl robot {self.name}: {self.n} joints>"

    def _repr_html_(self) -> str:
        from cellctl.facade.views import robot_view

        return robot_view(self)


def robot(source: str | Path | RobotFile | Robot) -> Robot:
    """A nominal robot: name of a library robot (`"ur10"`), path of a robot file, or a `RobotFile`.

    Raises InputError: no such robot or file, or every error in it with line and column.
    """
    from cellctl.operations.fitting import robot_of
    from cellctl.operations.shipped import shipped_file

    if isinstance(source, Robot):
        return source
    if isinstance(source, RobotFile):
        return Robot(source, Document(source.name, "", source.model_dump(), {(): (0, 0)}, {}))
    if isinstance(source, str | Path):
        document, file = robot_of(shipped_file("robot", Path(source)))
        return Robot(file, document)
    cure = "a library name such as 'ur10', the path of a robot file, or a RobotFile"
    raise refused("robot", f"is a {type(source).__name__}", cure)
