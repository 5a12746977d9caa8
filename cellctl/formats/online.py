"""The correction model of a model file: arrays for a robot's on-line correction, as canonical JSON with an id."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self, final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cellctl.calibration import Postures
from cellctl.compensation.online import online_arrays
from cellctl.files import InputError, Problem, canonical_json, sha256_of, write_atomically
from cellctl.files.validated import content_problems, read_json
from cellctl.formats.model import REGION_MARGIN_DEG, ModelFile
from cellctl.robot_file import Number

FORMAT: Literal["cellctl correction 1"] = "cellctl correction 1"
_CURE = "give a file that `online_correction` wrote"
_Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


@final
class CorrectionFile(BaseModel):
    """A correction model. id: SHA-256 of the other content. robot: the robot file's name; tool: of the model.

    model_sha256: of the model file's content. left_out: parts of the model that are not corrected on-line. arrays: by
    name, as `CorrectionModel` of `cellctl.devices` explains them.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    format: Literal["cellctl correction 1"] = FORMAT
    id: _Sha256
    robot: str
    model_sha256: _Sha256
    left_out: list[str]
    arrays: dict[str, list[Number]]

    @classmethod
    def of(cls, model: ModelFile, at: Postures | None = None) -> Self:
        """Of an identified robot, with the payload and temperature difference of `at`, one posture, throughout.

        Where a table's rows are allowed, the correction is whole; outside it fades to zero over another such margin.
        Raises ValueError for a model with an effect that cannot be computed on-line, InputError for a robot with a
        prismatic joint.
        """
        model.robot.refuse_prismatic(model.robot.name, "an on-line correction")
        region = model.joint_region
        found = online_arrays(
            model.robot_model(),
            model.robot.joint_map(),
            np.array(region.min) - REGION_MARGIN_DEG,
            np.array(region.max) + REGION_MARGIN_DEG,
            REGION_MARGIN_DEG,
            at,
        )
        content: dict[str, Any] = {
            "robot": model.robot.name,
            "model_sha256": sha256_of(model.text()),
            "left_out": list(found.left_out),
            "arrays": {name: list(values) for name, values in found.arrays.items()},
        }
        return cls(id=sha256_of({"format": FORMAT, **content}), **content)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a correction file. Raises InputError where it is none, or was changed."""
        content = read_json(path, "correction file", _CURE)
        try:
            found = cls.model_validate(content)
        except ValidationError as error:
            raise InputError(content_problems(error, path, "correction file", _CURE)) from error
        if found.id != sha256_of(found.model_dump(exclude={"id"})):
            raise InputError(Problem(str(path), 0, 0, "was changed after it was made", _CURE))
        return found

    def text(self) -> str:
        """The file's content: the same model gives the same bytes."""
        return canonical_json(self.model_dump()) + "\n"

    def save(self, path: Path) -> None:
        """Write the file. Raises OSError."""
        write_atomically(path, self.text())
