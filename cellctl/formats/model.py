"""Model files: an identified robot, how sure it is, where it was seen, what it was made from. Canonical JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cellctl.files import InputError, Problem, canonical_json, sha256_of, write_atomically
from cellctl.formats.measurements import Measurements, nominal_model
from cellctl.formats.robot import Number, RobotFile

if TYPE_CHECKING:
    from cellctl.calibration import FitResult, Prediction, RobotModel
    from cellctl.kinematics import Bools, Floats

Row = Annotated[list[Number], Field(min_length=4, max_length=4)]
Matrix = Annotated[list[Row], Field(min_length=4, max_length=4)]
_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)

REGION_MARGIN_DEG = 2.0
"""A reading this far outside those of the fit still counts as seen."""


@final
class Parameter(BaseModel):
    """One parameter's deviation from nominal (or, of base and tool, from `start`), its σ after and before the data."""

    model_config = _STRICT
    name: str
    unit: Literal["mm", "rad", "1/(N m^2)"]
    value: Number
    sigma: Number
    prior_sigma: Number


@final
class Centre(BaseModel):
    """Where a sphere turned out to be, mm, in the measuring frame."""

    model_config = _STRICT
    id: str
    xyz: list[Number]
    sigma: list[Number]


@final
class JointRegion(BaseModel):
    """Least and greatest controller reading of each joint among the rows of the fit, deg."""

    model_config = _STRICT
    min: list[Number]
    max: list[Number]


@final
class ModelFile(BaseModel):
    """An identified robot.

    robot: the nominal robot file. start: poses (4, 4) of base and tool from which their deviations count. covariance:
    of `parameters`, in their order, mm and rad. figures: what the fit said of itself. provenance: SHA-256 of what it
    was made from.
    """

    model_config = _STRICT
    format: Literal["cellctl model 1"] = "cellctl model 1"
    robot: RobotFile
    model: str
    start: dict[Literal["base", "tool"], Matrix]
    parameters: list[Parameter]
    covariance: list[list[Number]]
    centres: list[Centre] = []
    joint_region: JointRegion
    figures: dict[str, Any]
    provenance: dict[str, str]

    @classmethod
    def of(
        cls, robot: RobotFile, measured: Measurements, result: FitResult, provenance: dict[str, str] | None = None
    ) -> Self:
        """The model that a fit identified from `measured` rows; the robot's hash is added to `provenance`."""
        import numpy as np

        found = result.identification.identified
        unknowns, count = found.unknowns, found.unknowns.robot
        used = measured.readings[list(result.identification.used)]
        sigma = np.sqrt(np.diag(found.covariance))
        chain = unknowns.start.model.chain
        return cls(
            robot=robot,
            model=result.model,
            start={"base": chain.base.tolist(), "tool": chain.tool.tolist()},
            parameters=[
                Parameter(name=name, unit=_unit(name, turns), value=value, sigma=after, prior_sigma=before)
                for name, turns, value, after, before in zip(
                    unknowns.names[:count],
                    unknowns.start.model.parameter_turns.tolist(),
                    found.state.model.deviations.tolist(),
                    sigma.tolist(),
                    np.where(unknowns.free, unknowns.sigma, 0.0).tolist(),
                    strict=False,
                )
            ],
            covariance=found.covariance[:count, :count].tolist(),
            centres=_centres(measured.task.points, found.state.points, sigma[found.state.points_at :].reshape(-1, 3)),
            joint_region=JointRegion(min=used.min(axis=0).tolist(), max=used.max(axis=0).tolist()),
            figures=result.summary(),
            provenance={"robot_sha256": sha256_of(robot.model_dump()), **(provenance or {})},
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a model file. Raises InputError where it is none."""
        try:
            content = json.loads(path.read_bytes())
            model = cls.model_validate(content)
            model.robot_model()
        except OSError as error:
            raise InputError(Problem(str(path), 0, 0, f"cannot be read: {error.strerror}", "check the path")) from error
        except ValidationError as error:
            places = {".".join(str(part) for part in detail["loc"]): detail["msg"] for detail in error.errors()}
            problems = [
                Problem(str(path), 0, 0, f"is no model file: {at or 'content'}: {why}") for at, why in places.items()
            ]
            raise InputError(problems[:5]) from error
        except ValueError as error:
            what = f"is no model file: {error}"
            raise InputError(Problem(str(path), 0, 0, what, "give a file that `cellctl fit --out` wrote")) from error
        return model

    def text(self) -> str:
        """The file's content: the same model gives the same bytes."""
        return canonical_json(self.model_dump()) + "\n"

    def save(self, path: Path) -> None:
        """Write the file. Raises OSError."""
        write_atomically(path, self.text())

    def robot_model(self) -> RobotModel:
        """The identified robot. Raises ValueError where the parameters are not those of the robot."""
        import numpy as np

        bends = bool(self.parameters) and self.parameters[-1].name == "tool_deflection"
        nominal = nominal_model(self.robot, deflection=bends)
        placed = nominal.on(np.array(self.start["base"]), np.array(self.start["tool"]))
        if placed.parameters != tuple(parameter.name for parameter in self.parameters):
            raise ValueError("its parameters are not those of its robot")
        if np.shape(self.covariance) != (len(self.parameters),) * 2:
            raise ValueError("its covariance has another size than its parameters")
        return placed.with_deviations([parameter.value for parameter in self.parameters])

    def predict(self, readings: Floats) -> Prediction:
        """Tool poses and 1 σ at controller readings (N, n), deg."""
        import numpy as np

        from cellctl.calibration import predict

        return predict(self.robot_model(), np.array(self.covariance), self.robot.joint_map().model(readings))

    def sigma_among(self, readings: Floats) -> Floats | None:
        """1 σ (N,), 3-D, mm, of the tool centre points at readings (N, n), deg, among themselves: what moves all as one
        body is left out. None for fewer than four.
        """
        import numpy as np

        from cellctl.calibration import shape_sigma

        if len(readings) < 4:
            return None
        return shape_sigma(self.robot_model(), np.array(self.covariance), self.robot.joint_map().model(readings))

    def inside(self, readings: Floats) -> Bools:
        """Which readings (N, n), deg, lie in the joint region that the fit saw (N,); elsewhere it extrapolates."""
        import numpy as np

        lower, upper = np.array(self.joint_region.min), np.array(self.joint_region.max)
        seen = (readings >= lower - REGION_MARGIN_DEG) & (readings <= upper + REGION_MARGIN_DEG)
        return np.asarray(seen.all(axis=1))


def _unit(name: str, turns: bool) -> Literal["mm", "rad", "1/(N m^2)"]:
    if name == "tool_deflection":
        return "1/(N m^2)"
    return "rad" if turns else "mm"


def _centres(spheres: tuple[str, ...], centres: Floats, sigma: Floats) -> list[Centre]:
    rows = zip(spheres, centres.tolist(), sigma.tolist(), strict=True)
    return [Centre(id=name, xyz=place, sigma=spread) for name, place, spread in rows]
