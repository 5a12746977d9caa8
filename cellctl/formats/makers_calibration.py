"""A maker's own calibration of one arm, read as the nominal robot: in place of the data sheet's geometry.

Sources. UR: `calibration.conf` of the controller holds differences from the maker's Denavit-Hartenberg rows (m, rad);
a whole file is in github.com/MyRobotLab/pyrobotlab, issue 145. Universal_Robots_ROS2_Driver, ur_calibration, writes
link poses (m, rad) and the hash of the controller's rows. UFACTORY: xarm_ros2, xarm_description, gen_kinematics_params
writes the same six or seven poses, `joint1` … `joint7`.

Rows of almost parallel axes have lengths of hundreds of metres. The axes themselves are where the arm has them, so the
robot is taken by its axes, each through the point that is nearest to the data sheet's.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np

from cellctl.files import Document, InputError, Problem, load_yaml
from cellctl.formats.description import RobotDescription
from cellctl.formats.exports import UR_LINKS, ReadingAxes, reading_axes, turned_by
from cellctl.kinematics import Floats, JointAxis, Link, LinkTable, SerialChain, inverse_pose, pose_from_xyz_abc, to_mdh
from cellctl.robot_file import MakersCalibration, RobotFile

NEAR_DEG, NEAR_MM = 2.0, 15.0
"""The axes and the flange of a calibrated arm lie this near to those of its data sheet, or it is another robot. UR's
rows are up to about 0.3° and 3 mm from theirs, with joint zeros of up to 1°.
"""
_KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
_ROWS = ("delta_theta", "delta_a", "delta_d", "delta_alpha")
_LINEARISED = 2
_LIST = re.compile(r"^\s*(?P<name>\w+)\s*=\s*(?P<value>[^#\n]*)", re.MULTILINE)


def is_makers_calibration(path: Path) -> bool:
    """Whether `path` is named or written as one. Raises InputError where a YAML file cannot be read."""
    match path.suffix.lower():
        case ".conf":
            return True
        case ".yaml" | ".yml":
            return _is_link_poses(load_yaml(path))
        case _:
            return False


def _is_link_poses(document: Document) -> bool:
    return isinstance(document.data, dict) and isinstance(document.data.get("kinematics"), dict)


@final
@dataclass(frozen=True, eq=False)
class Calibrated:
    """robot: by the maker's calibration. apart_mm: largest distance of an axis or the flange from the data sheet's, at
    readings 0; apart_deg: largest angle.
    """

    robot: RobotDescription
    apart_mm: float
    apart_deg: float


_MOC = re.compile(r"^MOC:CFG_|^MOTOR_CALIB:", re.MULTILINE)
_CAL_OFFSET = re.compile(r'-name\s+"([^"]*)"(?:(?!-name)[^#])*?-cal_offset\s+(-?[\d.]+)')


def refuse_motor_angles(path: Path) -> None:
    """Raise InputError for ABB's `MOC.cfg`: names what is in it, and why it is not read."""
    if path.suffix.lower() != ".cfg" or not path.is_file():
        return
    text = path.read_text("latin-1")
    if not _MOC.search(text):
        return
    axes = ", ".join(f"{name} {offset}" for name, offset in _CAL_OFFSET.findall(text)) or "none"
    what = f"is ABB's MOC.cfg: its cal_offset ({axes}) are angles of the motors, and its lengths are not described"
    raise InputError(Problem(str(path), 0, 0, what, "start from the library's robot file (`cellctl robots`)"))


def load_calibration(path: Path, sheet: RobotFile) -> Calibrated:
    """The robot of the data sheet `sheet` as its maker calibrated it.

    Joint limits, speeds, base, tool and mounting are those of `sheet`. Raises InputError where the file is not whole,
    or is of another robot.
    """
    nominal = RobotDescription.of(sheet)
    if path.suffix.lower() == ".conf":
        chain, known = _ur_rows(path, nominal), None
        axes = reading_axes(replace(nominal, chain=chain))
    else:
        axes, known = _link_poses(path, nominal)
    return _calibrated(str(path), sheet, axes, MakersCalibration(file=path.name, hash=known))


def calibration_of_rows(links: Sequence[Link], controller: str, sheet: RobotFile) -> Calibrated:
    """The robot of the data sheet `sheet` by rows (`mdh-hayati`) that its `controller` stated. Raises InputError."""
    nominal = RobotDescription.of(sheet)
    if len(links) != sheet.n:
        raise InputError(Problem(controller, 0, 0, f"states {len(links)} rows for {sheet.n} joints", "give its robot"))
    chain = SerialChain.from_links("mdh-hayati", links, nominal.chain.base, nominal.chain.tool)
    axes = reading_axes(replace(nominal, chain=chain))
    return _calibrated(controller, sheet, axes, MakersCalibration(file=controller))


def _calibrated(name: str, sheet: RobotFile, axes: ReadingAxes, calibration: MakersCalibration) -> Calibrated:
    """The robot of `sheet` by other axes; name: of the source in errors."""
    nominal = RobotDescription.of(sheet)
    points = _nearest(reading_axes(nominal).points, axes)
    through = [JointAxis.through(point, along) for point, along in zip(points, axes.along, strict=True)]
    chain = SerialChain.from_axes(through, axes.flange, nominal.chain.base, nominal.chain.tool)
    joints = tuple(replace(joint, sign=1, offset=0.0) for joint in nominal.joints)
    robot = replace(nominal, chain=chain, joints=joints, calibration=calibration)
    apart = _apart(nominal, robot)
    if apart[0] > NEAR_MM or apart[1] > NEAR_DEG:
        what = f"is not of a {sheet.name}: an axis or the flange is {apart[0]:.1f} mm and {apart[1]:.1f}° from its"
        raise InputError(Problem(name, 0, 0, what, "give the robot of this calibration with --robot"))
    return Calibrated(robot, *apart)


def _ur_rows(path: Path, nominal: RobotDescription) -> SerialChain:
    """The maker's rows and the differences of `calibration.conf`."""
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(Problem(str(path), 0, 0, f"cannot be read: {error}", "give the controller's file")) from None
    found = {
        match["name"]: (match["value"].strip(), text.count("\n", 0, match.start("name")) + 1)
        for match in _LIST.finditer(text)
    }
    rows = [_six(str(path), found, name) for name in _ROWS]
    status, line = found.get("calibration_status", (str(_LINEARISED), 0))
    if status != str(_LINEARISED):
        what = f"states calibration_status {status}: the controller does not use these numbers"
        raise InputError(Problem(str(path), line, 0, what, "calibrate the arm, or use the data sheet's robot file"))
    chain = to_mdh(nominal.chain)
    assert isinstance(chain.table, LinkTable)
    joints = nominal.joint_map()
    if joints.n != len(UR_LINKS) or (joints.sign != 1.0).any():
        what = f"is of a UR, and {nominal.name} is none: give its robot with --robot"
        raise InputError(Problem(str(path), 0, 0, what, "`cellctl robots` names them"))
    links = [
        Link(row.theta + theta, row.d + 1000.0 * d, row.a + 1000.0 * a, row.alpha + alpha)
        for row, theta, a, d, alpha in zip(chain.table.links, *rows, strict=True)
    ]
    return SerialChain.from_links("mdh-hayati", links, nominal.chain.base, nominal.chain.tool)


def _six(file: str, found: dict[str, tuple[str, int]], name: str) -> list[float]:
    text, line = found.get(name, ("", 0))
    try:
        numbers = [float(part) for part in text.removeprefix("[").removesuffix("]").split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != len(UR_LINKS) or not np.isfinite(numbers).all():
        what = f"{name} is not there" if not line else f"{name} is not a list of six numbers"
        raise InputError(Problem(file, line, 0, what, "give the whole calibration.conf of the controller"))
    return numbers


def _link_poses(path: Path, nominal: RobotDescription) -> tuple[ReadingAxes, str | None]:
    """The axes of the joints' frames, each turning about its own z; and the hash, where the file has one.

    The last frame is the flange: `tool0` and `link_eef` of the description packages have no other place.
    """
    document, n = load_yaml(path), len(nominal.joints)
    section = document.data["kinematics"]
    names = UR_LINKS if UR_LINKS[0] in section else tuple(f"joint{axis}" for axis in range(1, n + 1))
    problems = [
        document.problem(("kinematics",), f"'{name}' is missing, for a {nominal.name}", f"joints: {', '.join(names)}")
        for name in names
        if name not in section
    ]
    unknown = sorted(set(section) - {*names, "hash"})
    if unknown or len(names) != n:
        what = f"has {len(section)} entries, and a {nominal.name} has {n} joints: {', '.join(map(str, section))}"
        problems.append(document.problem(("kinematics",), what, "give the robot of this calibration with --robot"))
    if problems:
        raise InputError(problems)
    steps = [_pose(document, section[name], name) for name in names]
    frames = list(itertools.accumulate(steps, np.matmul))
    known = section.get("hash")
    axes = ReadingAxes(
        np.array([frame[:3, 3] for frame in frames]), np.array([frame[:3, 2] for frame in frames]), frames[-1]
    )
    return axes, known if isinstance(known, str) else None


def _pose(document: Document, row: object, name: str) -> Floats:
    """Pose (4, 4), mm, of one joint's frame in the one before."""
    values = [row.get(key) for key in _KEYS] if isinstance(row, dict) else []
    numbers = [float(value) for value in values if isinstance(value, int | float) and math.isfinite(value)]
    if len(numbers) != len(_KEYS):
        what = f"'{name}' is not six numbers {', '.join(_KEYS)}, m and rad"
        raise InputError(
            document.problem(("kinematics", name), what, "give the file as the description package has it")
        )
    x, y, z, roll, pitch, yaw = numbers
    return pose_from_xyz_abc([1000.0 * x, 1000.0 * y, 1000.0 * z], np.degrees([yaw, pitch, roll]))


def _apart(nominal: RobotDescription, found: RobotDescription) -> tuple[float, float]:
    """Largest distance, mm, and angle, deg, of an axis or the flange at readings 0."""
    one, other = reading_axes(nominal), reading_axes(found)
    cosines = np.clip(np.sum(one.along * other.along, axis=1), -1.0, 1.0)
    across = np.eye(3) - one.along[:, :, None] * one.along[:, None, :]
    apart = np.einsum("nij,nj->ni", across, _nearest(one.points, other) - one.points)
    flange = inverse_pose(one.flange) @ other.flange
    away = [*np.linalg.norm(apart, axis=1).tolist(), float(np.linalg.norm(flange[:3, 3]))]
    turned = [*np.degrees(np.arccos(cosines)).tolist(), math.degrees(turned_by(np.eye(4), flange))]
    return max(away), max(turned)


def _nearest(points: Floats, axes: ReadingAxes) -> Floats:
    """The points (n, 3) on the axes that are nearest to `points` (n, 3)."""
    shares = np.sum((points - axes.points) * axes.along, axis=1)
    return np.asarray(axes.points + shares[:, None] * axes.along)
