"""A robot of which one reflector is measured: postures for its places, identification, and the table of errors.

Readings are A1…An, deg (N, n); places are of the reflector in the robot's base frame, mm (N, 3).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self, final

import numpy as np
import yaml
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from cellctl.calibration import FitResult, RobotModel, Split, fit
from cellctl.error_maps.samples import Scale
from cellctl.formats import DataSet, RobotFile, measurements
from cellctl.installed import robot_file
from cellctl.kinematics import JointMap, Link, SerialChain, inverse, to_poe
from cellctl.planning import JointRanges, Method, Reach, TargetOptions, TaskWorkspace, plan_targets
from tests.studies.papers.statements import Numbers
from tests.studies.papers.world import Floats, Ways

_TURN, _SLIDE = 1e-3, 1.0
"""Units of the parameters in the least squares, rad and mm."""

_SEEN = 1e-3
"""Least singular value of the scaled Jacobian that counts, as a share of the greatest."""


@final
@dataclass(frozen=True, eq=False)
class Arm:
    """The nominal robot with its first reflector as TCP."""

    file: RobotFile
    reflector: Floats

    @classmethod
    def of(cls, cell: Path) -> Self:
        """The robot of a cell file."""
        content = yaml.safe_load(cell.read_text(encoding="utf-8"))
        file = RobotFile.load(robot_file(content["model"], cell.parent))
        return cls(file, np.array(content["reflectors"]["on_flange"][0]["xyz"], float))

    @cached_property
    def chain(self) -> SerialChain:
        """The TCP at the reflector, turned as the file's tool."""
        tool = self.file.chain().tool.copy()
        tool[:3, 3] = self.reflector
        return self.file.chain().with_tool(tool)

    @cached_property
    def joints(self) -> JointMap:
        """Between readings and model angles."""
        return self.file.joint_map()

    def places(self, readings: Floats) -> Floats:
        """Where the reflector would be (N, 3)."""
        return np.asarray(self.chain.forward(self.joints.model(readings))[:, :3, 3])

    def readings(self, poses: Floats, start: Floats) -> Floats:
        """Readings (M, n) that put the TCP at those of the poses (N, 4, 4) that can be reached within the limits,
        from readings `start` (n,) or (N, n).
        """
        begin = np.broadcast_to(self.joints.model(np.atleast_2d(start)), (len(poses), self.chain.n))
        found = inverse(self.chain, poses, begin, tolerance_mm=1e-6, tolerance_rad=1e-9)
        readings, limits = self.joints.readings(found.q), self.file.limits()
        inside = ((readings > limits[:, 0]) & (readings < limits[:, 1])).all(axis=1)
        return np.asarray(readings[found.converged & inside])

    def drawn(
        self, region: TaskWorkspace | JointRanges, method: Method, fit: int, held_out: int, seed: int, near: Floats
    ) -> Floats:
        """Planned readings (fit + held_out, n), those of the fit first."""
        limits = self.file.limits()
        reach = Reach(tuple(limits[:, 0].tolist()), tuple(limits[:, 1].tolist()), margin=5.0)
        options = TargetOptions(near=near)
        found = plan_targets(self.chain, self.joints, reach, region, method, fit, held_out, seed, options)
        return np.concatenate([found.readings[~found.held_out], found.readings[found.held_out]])

    def table(self, *, convention: str) -> SerialChain:
        """The nominal robot as `poe`, as `mdh` (with β), or as `dh` (without)."""
        if convention == "poe":
            return to_poe(self.chain)
        if convention == "mdh":
            return self.chain
        links = [Link(link.theta, link.d, link.a, link.alpha, None) for link in self.chain.table.links]
        return SerialChain.from_links("mdh-hayati", links, self.chain.base, self.chain.tool)


def least_squares(chain: SerialChain, q: Floats, places: Floats, rounds: int = 8) -> SerialChain:
    """The chain with base, links and tool by least squares from places (N, 3) at model angles q (N, n), rad.

    Without a prior, as the papers do it; of what the places do not show, the smallest change is taken.
    """
    unit = np.where(chain.parameter_turns, _TURN, _SLIDE)
    found = np.zeros(len(unit))
    for _ in range(rounds):
        now = chain.with_parameters(found)
        left = (places - now.forward(q)[:, :3, 3]).reshape(-1)
        columns = now.parameter_jacobian(q)[:, :3].reshape(-1, len(unit)) * unit
        step, *_ = np.linalg.lstsq(columns, left, rcond=_SEEN)
        found = found + unit * step
    return chain.with_parameters(found)


def data_of(
    readings: Floats,
    places: Floats,
    held_out: int,
    sigma_mm: float,
    *,
    currents: Floats | None = None,
    ways: Ways | None = None,
) -> DataSet:
    """A data set of places, the last `held_out` of set `test`. sigma_mm: 1 σ on each axis; currents (N, n), A; ways
    (N, n): sign of each joint's last motion.
    """
    columns: dict[str, Floats] = {f"A{axis}": angle for axis, angle in enumerate(readings.T, 1)}
    columns |= dict(zip("XYZ", places.T, strict=True))
    columns |= {name: np.full(len(readings), sigma_mm) for name in ("sX", "sY", "sZ")}
    columns |= {} if currents is None else {f"I{axis}": one for axis, one in enumerate(currents.T, 1)}
    columns |= {} if ways is None else {f"D{axis}": one for axis, one in enumerate(ways.T, 1)}
    sets = ["fit"] * (len(readings) - held_out) + ["test"] * held_out
    rows = zip(*columns.values(), strict=True)
    return DataSet.of_records(
        {**{name: float(value) for name, value in zip(columns, row, strict=True)}, "set": of}
        for row, of in zip(rows, sets, strict=True)
    )


def fitted(arm: Arm, data: DataSet, model: str = "auto") -> FitResult:
    """The ordinary fit of this project: `cellctl fit ROBOT DATA --model MODEL`."""
    measured = measurements(arm.file, data, measure="position", model=model)
    return fit(measured.task, Split.by_column(np.array([of == "test" for of in measured.sets])))


def identified(result: FitResult) -> RobotModel:
    """The identified robot."""
    return result.identification.identified.state.model


@final
@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """A peer's map (`ErrorMap`): one Gaussian process of scikit-learn for each component."""

    inputs: Scale
    outputs: Scale
    components: tuple[GaussianProcessRegressor, ...]

    def errors(self, q: Floats) -> Floats:
        """Errors (N, 3) at inputs (N, k)."""
        at = self.inputs.standardised(q)
        return self.outputs.restored(np.stack([one.predict(at) for one in self.components], axis=-1))


def gaussian_process(q: Floats, errors: Floats, seed: int, restarts: int = 2) -> GaussianProcess:
    """Fitted to errors (N, 3) at inputs (N, k): a scale for each input (ARD), white noise, by marginal likelihood."""
    inputs, outputs = Scale.of(q), Scale.of(errors)
    at, found = inputs.standardised(q), []
    for each in outputs.standardised(errors).T:
        kernel = ConstantKernel(1.0, (1e-2, 1e3)) * RBF(np.ones(q.shape[1]), (1e-1, 1e3)) + WhiteKernel(
            1e-3, (1e-7, 1.0)
        )
        process = GaussianProcessRegressor(kernel, n_restarts_optimizer=restarts, random_state=seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a scale at its bound: an input that says nothing
            found.append(process.fit(at, each))
    return GaussianProcess(inputs, outputs, tuple(found))


def figures(name: str, errors: Floats) -> Numbers:
    """Mean, maximum and root mean square of the lengths of errors (N, 3), mm."""
    lengths = np.linalg.norm(errors, axis=1)
    return {
        f"{name}_mean": float(lengths.mean()),
        f"{name}_max": float(lengths.max()),
        f"{name}_rms": float(np.sqrt(np.mean(lengths**2))),
    }
