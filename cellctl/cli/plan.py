"""`cellctl plan`: targets for a calibration, to be measured with any instrument, and the errors in its options."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar, final

import numpy as np
import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_json_on_stdout, refuse_outputs, to_stdout, write_json
from cellctl.cli.plan_layout import plan_layout
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import RobotFile
from cellctl.formats.targets import read_path, targets_text
from cellctl.kinematics import JointUnit
from cellctl.operations.fit_options import option
from cellctl.operations.optimal_plan import Aim, DesignFigures, OptimalChoice
from cellctl.operations.results import as_json
from cellctl.planning import (
    METHODS,
    JointRanges,
    OutOfReach,
    Reach,
    Sight,
    TargetOptions,
    TargetSet,
    TaskWorkspace,
    plan_targets,
)
from cellctl.planning.design import CRITERIA

_Read = TypeVar("_Read")

ACCEPTANCE_DEG, FACES_ANYWHERE_DEG = 27.0, 180.0


@final
@dataclass
class Asked:
    """The options as given; what each means is in the help of `cellctl plan`."""

    method: str
    n: int
    held_out: int
    box: str | None
    angles: str | None
    joints: str | None
    path: Path | None
    dense: int | None
    partitions: int | None
    near: str | None
    station: str | None
    reflector: str | None
    facing: str | None
    acceptance: float | None
    floor: float | None
    aim: Aim
    problems: list[Problem] = field(default_factory=list)

    def refuse(self) -> None:
        """Raise InputError with all errors that need no robot."""
        if self.method not in METHODS:
            self._add("method", f"'{self.method}' is not known", f"one of {', '.join(METHODS)}")
        if (self.box is None) == (self.joints is None):
            what = "targets are drawn from one region"
            self._add("box", what, "--box X,Y,Z and --angles A,B,C, or --joints, each as ranges such as 900:1300")
        if self.box is not None and self.angles is None:
            self._add("angles", "a box alone has no orientation", "--angles 0,180,0 for a constant one, or ranges")
        if self.box is None and self.angles is not None:
            self._add("angles", "belongs to --box", "give --box too, or leave it out")
        if self.method == "near-path" and self.path is None:
            self._add("path", "near-path needs a path", "--path FILE.csv with X, Y, Z in mm")
        if self.path is not None and self.method != "near-path":
            self._add("path", f"{self.method} uses no path", "--method near-path, or leave --path out")
        if self.partitions is not None and self.method != "joint-uniform":
            self._add("partitions", f"{self.method} has no partitions", "--method joint-uniform, or leave it out")
        if self.dense is not None and self.method not in ("joint-uniform", "near-path", "optimal"):
            cure = "--optimal, --method joint-uniform or near-path, or leave it out"
            self._add("dense", f"{self.method} does not choose", cure)
        if self.method != "optimal":
            for name, value in vars(Aim()).items():
                if getattr(self.aim, name) != value:
                    self._add(name.removesuffix("_mm"), "is for an optimal choice", "--optimal too, or leave it out")
        if self.aim.criterion not in CRITERIA:
            self._add("criterion", f"'{self.aim.criterion}' is not known", f"one of {', '.join(CRITERIA)}")
        if self.aim.prior is not None and self.aim.model != Aim.model:
            self._add("model", "with --prior the model is that file's", "leave --model or --prior out")
        if self.dense is not None and self.dense < max(self.n, self.held_out):
            self._add("dense", f"{self.dense} samples are fewer than the targets", f"{10 * self.n} or so")
        if self.station is None and (self.reflector or self.facing):
            self._add("station", "a reflector is seen from a station", "--station X,Y,Z too")
        if self.acceptance is not None and self.facing is None:
            self._add("acceptance", "is an angle about the reflector's direction", "--facing x,y,z too")
        if self.near is not None and self.joints is not None:
            self._add("near", "joint ranges have one posture for each target", "leave --near out")
        self.raise_all()

    def region(self, robot: RobotFile) -> TaskWorkspace | JointRanges | None:
        """The region; None where its text has an error, which is then noted."""
        if self.joints is not None:
            ends = self._ranges("joints", self.joints, robot.n)
            return None if ends is None else self._made("joints", lambda: JointRanges(*np.array(ends).T))
        box = self._ranges("box", self.box or "", 3)
        angles = self._ranges("angles", self.angles or "", 3)
        if box is None or angles is None:
            return None
        return self._made("box", lambda: TaskWorkspace.of([*box, *angles]))

    def options(self, robot: RobotFile) -> TargetOptions | None:
        """What rejects a target, and the method's own settings; None where a text has an error."""
        near = None if self.near is None else self._numbers("near", self.near, robot.n)
        sight = self._sight(robot) if self.station else None
        try:
            path = read_path(self.path) if self.path else None
        except InputError as error:
            self.problems += error.problems
            return None
        posture = None if near is None else np.array(near)
        return TargetOptions(posture, self.dense, self.partitions, path, sight=sight, floor=self.floor)

    def raise_all(self) -> None:
        """Raise InputError with every error noted."""
        if self.problems:
            raise InputError(self.problems)

    def _sight(self, robot: RobotFile) -> Sight | None:
        station = self._numbers("station", self.station or "", 3)
        reflector = self._numbers("reflector", self.reflector, 3) if self.reflector else robot.tool.xyz
        facing = self._numbers("facing", self.facing, 3) if self.facing else [0.0, 0.0, 1.0]
        acceptance = ACCEPTANCE_DEG if self.acceptance is None else self.acceptance
        if not 0.0 < acceptance < 90.0:
            self._add("acceptance", f"{acceptance:g}° is no half angle of a reflector", "between 0 and 90")
        if facing is not None and not any(facing):
            self._add("facing", "0,0,0 is no direction", "a vector in the flange frame")
        if station is None or reflector is None or facing is None or not any(facing):
            return None
        angle = acceptance if self.facing else FACES_ANYWHERE_DEG
        return Sight(np.array(station), np.array([reflector]), np.array([facing]), acceptance=angle)

    def _made(self, name: str, make: Callable[[], _Read]) -> _Read | None:
        try:
            return make()
        except ValueError as error:
            self._add(name, str(error), "lower:upper for each, in mm and degrees")
            return None

    def _ranges(self, name: str, text: str, count: int) -> list[tuple[float, float]] | None:
        """`count` ranges `lower:upper`; one number is a constant."""
        parts = [part.split(":") for part in text.split(",")]
        ends = [tuple(map(_number, part if len(part) > 1 else part * 2)) for part in parts]
        if len(ends) == count and all(len(pair) == 2 and None not in pair for pair in ends):
            return [(float(low or 0.0), float(high or 0.0)) for low, high in ends]
        self._add(name, f"'{text}' is not {count} ranges", ",".join(["lower:upper"] * count))
        return None

    def _numbers(self, name: str, text: str, count: int) -> list[float] | None:
        found = [_number(part) for part in text.split(",")]
        if len(found) == count and None not in found:
            return [float(value or 0.0) for value in found]
        self._add(name, f"'{text}' is not {count} numbers", "numbers separated by commas")
        return None

    def _add(self, name: str, what: str, cure: str) -> None:
        self.problems.append(option(name, what, cure))


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


_RANGES = "lower:upper for each, separated by commas; one number is a constant"


def plan(
    robot: arguments.Robot,
    n: Annotated[int, typer.Option("--n", min=1, help="Targets for the fit.")],
    method: Annotated[
        str,
        typer.Option(
            help="quasi-random, halton, joint-uniform, near-path, optimal; baselines: pseudo-random, clustered."
        ),
    ] = "quasi-random",
    optimal: Annotated[
        bool, typer.Option("--optimal", help="Of many samples those that leave the least predicted error.")
    ] = False,
    criterion: Annotated[
        str,
        typer.Option(
            help="Optimal: volume, max: mean or largest variance over the task; D, A: of the parameters; G: of samples."
        ),
    ] = Aim.criterion,
    model: Annotated[str, typer.Option(help="Optimal: model of the later fit, as in `cellctl fit`.")] = Aim.model,
    prior: Annotated[
        Path | None, typer.Option(help="Optimal: model file of an earlier fit; its uncertainty is the prior.")
    ] = None,
    task: Annotated[
        Path | None, typer.Option(help="Optimal: CSV of targets that matter: X, Y, Z, A, B, C. Default: the region.")
    ] = None,
    sigma: Annotated[
        float, typer.Option(min=1e-6, help="Optimal: 1 σ of the instrument on each axis, mm.")
    ] = Aim.sigma_mm,
    poses: Annotated[bool, typer.Option("--poses", help="Optimal: the instrument measures orientation too.")] = False,
    held_out: Annotated[int, typer.Option(min=0, help="Further targets for judging; adds the column set.")] = 0,
    box: Annotated[str | None, typer.Option(help=f"Ranges of X, Y, Z of the TCP, mm: {_RANGES}.")] = None,
    angles: Annotated[str | None, typer.Option(help="Ranges of A, B, C, deg, in the same form.")] = None,
    joints: Annotated[str | None, typer.Option(help="In place of --box: ranges of A1…An, deg.")] = None,
    path: Annotated[Path | None, typer.Option(help="CSV with X, Y, Z along the path, mm, for near-path.")] = None,
    dense: Annotated[
        int | None, typer.Option(min=1, help="Samples from which joint-uniform, near-path and optimal choose.")
    ] = None,
    partitions: Annotated[int | None, typer.Option(min=1, help="Parts of each joint, for joint-uniform.")] = None,
    near: Annotated[
        str | None, typer.Option(help="A1,…,An, deg: a posture in the configuration that all targets have.")
    ] = None,
    station: Annotated[
        str | None, typer.Option(help="X,Y,Z of the instrument, mm: targets are visible from it.")
    ] = None,
    reflector: Annotated[
        str | None, typer.Option(help="X,Y,Z of the reflector in the flange frame, mm. Default: the TCP.")
    ] = None,
    facing: Annotated[
        str | None, typer.Option(help="x,y,z: the reflector's direction in the flange frame. Default: turned by hand.")
    ] = None,
    acceptance: Annotated[
        float | None, typer.Option(help="Half angle within which it reflects, deg; with --facing. Default: 27.")
    ] = None,
    floor: Annotated[float | None, typer.Option(help="Height of the floor, mm; targets keep 100 mm from it.")] = None,
    layout: Annotated[
        Path | None,
        typer.Option(
            help="Cell file: in place of targets, where its spheres, or instrument and nests, should be.",
            callback=arguments.cell_or_none,
        ),
    ] = None,
    places: Annotated[int, typer.Option(min=4, max=500, help="Layout: possible places that are tried for each.")] = 24,
    seed: Annotated[int, typer.Option(min=0, help="Seed: the same one gives the same targets.")] = 0,
    out: arguments.Out = None,
    json_: arguments.Json = None,
) -> None:
    """Choose targets for a calibration with any instrument.

    Writes a CSV: joints A1…An, nominal pose of the TCP, and empty columns X, Y, Z. Measure, fill these in, and give the
    file to `cellctl fit`. Positions are in the frame of the robot file. Targets keep 5° (5 mm) from the joint limits.

    Example: cellctl plan kr5_r1400 --n 80 --box 850:1250,-300:300,200:600 --angles 0,180,0 -o targets.csv

    Varied orientation, even joints: --method joint-uniform --angles 85:95,75:105,60:120

    Near a path: --method near-path --n 500 --path path.csv

    Least predicted error: --optimal --task seam.csv

    Where the spheres of a cell should be: cellctl plan kr5_r1400 --n 35 --layout sphere_cell -o places.yaml
    """
    if layout is not None:
        given = {"box": box, "joints": joints, "path": path, "station": station, "task": task, "prior": prior}
        for name, value in given.items():
            if value is not None:
                raise InputError(option(name, "is for targets, not for a layout", "leave it or --layout out"))
        refuse_json_on_stdout(json_, out, "the lines of the cell file")
        refuse_outputs({"--out": out, "--json": json_}, [robot, layout])
        file = RobotFile.load(robot)
        file.refuse_prismatic(str(robot), "cellctl plan --layout")
        plan_layout(layout, file, n, places, seed, out, json_)
        return
    asked = Asked(
        "optimal" if optimal else method, n, held_out, box, angles, joints, path, dense, partitions, near, station,
        reflector, facing, acceptance, floor, Aim(criterion, model, prior, task, sigma, poses),  # type: ignore[arg-type]
    )  # fmt: skip  # `refuse` looks at the criterion
    if optimal and method not in ("quasi-random", "optimal"):
        raise InputError(option("method", f"{method} is no optimal choice", "leave --method or --optimal out"))
    asked.refuse()

    refuse_json_on_stdout(json_, out, "the CSV")
    refuse_outputs({"--out": out, "--json": json_}, [robot, path, prior, task])
    file = RobotFile.load(robot)
    if station is not None or floor is not None:
        file.refuse_prismatic(str(robot), "cellctl plan --station or --floor")
    targets, designed = _targets(file, asked, seed)
    if out:
        write_atomically(out, targets_text(targets))
        if json_ != "-":
            typer.echo(_words(targets, file.joint_map().units, designed, out))
    else:
        to_stdout(targets_text(targets))
    found = {"method": asked.method, "seed": seed, **_figures(targets)}
    found |= {"design": as_json(designed)} if designed else {}
    write_json({**found, "file": str(out) if out else None}, json_)


def _targets(file: RobotFile, asked: Asked, seed: int) -> tuple[TargetSet, DesignFigures | None]:
    """The targets, and what an optimal choice predicts. Raises InputError where the options or the region do not allow
    them.
    """
    region, options = asked.region(file), asked.options(file)
    asked.raise_all()
    assert region is not None
    assert options is not None
    choice = OptimalChoice(file, asked.aim) if asked.method == "optimal" else None
    low, high = file.limits().T.tolist()
    reach = Reach(tuple(low), tuple(high))
    try:
        found = plan_targets(
            file.chain(), file.joint_map(), reach, region, asked.method, asked.n, asked.held_out, seed,  # type: ignore[arg-type]  # `Asked.refuse` has looked at the method
            replace(options, choose=choice),
        )  # fmt: skip
        return found, choice.figures if choice else None
    except (OutOfReach, ValueError) as error:
        what, _, cure = str(error).partition(": ")
        raise InputError(option("joints" if asked.joints else "box", what, cure)) from error


def _figures(targets: TargetSet) -> dict[str, Any]:
    axes = [f"A{number}" for number in range(1, targets.readings.shape[1] + 1)]
    fit = targets.readings[~targets.held_out]
    return {
        "n": int(np.count_nonzero(~targets.held_out)),
        "held_out": int(np.count_nonzero(targets.held_out)),
        "drawn": targets.drawn,
        "usable": targets.usable,
        "rejected": targets.rejected,
        "joints": {
            name: {"min": low, "max": high, "filled": share}
            for name, low, high, share in zip(
                axes, fit.min(axis=0).tolist(), fit.max(axis=0).tolist(), targets.filled.tolist(), strict=True
            )
        },
    }


def _words(targets: TargetSet, units: Sequence[JointUnit], designed: DesignFigures | None, out: Path) -> str:
    figures = _figures(targets)
    judges = f" and {figures['held_out']} held-out" if figures["held_out"] else ""
    lines = [f"{out}: {figures['n']} targets{judges}, {figures['usable']} of {figures['drawn']} samples usable."]
    lines += [f"  rejected, {reason}: {count}" for reason, count in figures["rejected"].items() if count]
    spans = (
        f"  {name} {span['min']:.1f}…{span['max']:.1f}{' mm' if unit == 'mm' else unit}, "
        f"{100 * span['filled']:.0f} % of its parts filled"
        for (name, span), unit in zip(figures["joints"].items(), units, strict=True)
    )
    if designed:
        lines += _predicted(designed, figures["n"])
    lines += [*spans, "Fill in X, Y, Z as measured; add A, B, C if the instrument measures orientation."]
    return "\n".join(lines)


def _predicted(designed: DesignFigures, count: int) -> list[str]:
    """What an optimal choice promises, and how far its rows check each other."""
    checked = (
        f"without any one row it rises by at most {designed.without_one_percent:.0f} %"
        if designed.checkable
        else f"without one row, which the others cannot check, it rises by {designed.without_one_percent:.0f} %"
    )
    return [
        f"  predicted 1 σ (3-D) over {designed.task} places of the task after the fit: {designed.sigma_mm:.3f} mm, at "
        f"most {designed.largest_mm:.3f} mm; with {count} samples taken evenly {designed.even_sigma_mm:.3f} and "
        f"{designed.even_largest_mm:.3f} mm; {checked}.",
    ]
