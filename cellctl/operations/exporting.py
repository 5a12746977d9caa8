"""A robot or an identified model in another form, with what that form cannot hold and what this costs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile, RobotFile
from cellctl.formats.description import RobotDescription, robot_text
from cellctl.formats.dh_table import dh_table_text, load_dh_table
from cellctl.formats.exports import (
    Cost,
    FittedForm,
    JointZeros,
    abb_text,
    effects_left_out,
    fanuc_text,
    fitted_geometry,
    hash_of,
    joint_zeros,
    kuka_text,
    ur_calibration,
    urdf_into,
)
from cellctl.formats.makers_calibration import Calibrated, is_makers_calibration, load_calibration, refuse_motor_angles
from cellctl.formats.urdf import load_urdf, urdf_text
from cellctl.kinematics import Convention, Floats, TableConvention, abc_from_rotation
from cellctl.robot_file import prismatic_numbers, refuse_prismatic

ROBOT_FILES: dict[str, Convention] = {"mdh-hayati": "mdh-hayati", "dh-craig": "dh-craig", "poe": "poe"}
JOINT_ZEROS = ("kuka", "abb", "fanuc")
"""Forms that hold joint zeros, not the geometry of the links; they need a model."""
_WITHOUT_MOUNTING = ("urdf", "dh-csv")


@final
@dataclass(frozen=True, eq=False)
class Source:
    """What is converted. file: its name in errors. robot: with the identified geometry; nominal: without it, and the
    same where the source is no model. model: None where it is none. notes: to whom reads it.
    """

    file: str
    robot: RobotDescription
    nominal: RobotDescription
    model: ModelFile | None = None
    notes: tuple[str, ...] = ()


@final
@dataclass(frozen=True, slots=True)
class ExportOptions:
    """table: convention of a DH table. into: the user's own file, tip: its last link. tool, base: KUKA's numbers."""

    table: TableConvention | None = None
    into: Path | None = None
    tip: str | None = None
    tool: int = 1
    base: int = 1


@final
@dataclass(frozen=True, eq=False)
class Exported:
    """content: of the file. left_out: what has no place in the form; cost: of that. notes: what else to do or know.
    figures: for the JSON.
    """

    content: str | bytes
    left_out: tuple[str, ...]
    cost: Cost | None
    notes: tuple[str, ...]
    figures: dict[str, Any]

    def lines(self) -> list[str]:
        """What is left out and its cost, and the notes, a sentence each."""
        if not self.left_out:
            return list(self.notes)
        cost = f"; without it the TCP is off by {self.cost.words}" if self.cost else ""
        return [f"left out, as this form has no place for it: {', '.join(self.left_out)}{cost}", *self.notes]


def model_source(model: ModelFile, file: str) -> Source:
    """A model; `file` names it in errors."""
    identified = RobotDescription.of(model.robot, model.robot_model().chain)
    return Source(file, identified, RobotDescription.of(model.robot), model)


def read_source(
    path: Path, tip: str | None, table: str | None, repeatability: float | None, sheet: Path | None = None
) -> Source:
    """The robot or model of a file, by its suffix. sheet: robot file of the data sheet, of a maker's calibration.

    Raises InputError where it is none, or states its repeatability.
    """
    refuse_motor_angles(path)
    if is_makers_calibration(path):
        return _calibrated(path, repeatability, sheet)
    if sheet is not None:
        what = "is for a maker's calibration, and this is none"
        raise InputError(Problem("--robot", 0, 0, what, "leave it out"))
    model = None
    match path.suffix.lower():
        case ".json":
            model = ModelFile.load(path)
            robot = RobotDescription.of(model.robot, model.robot_model().chain)
        case ".yaml" | ".yml":
            robot = RobotDescription.of(RobotFile.load(path))
        case ".urdf":
            robot = load_urdf(path, tip)
        case ".csv":
            robot = load_dh_table(path, table)
        case _:
            cure = "its name ends in .yaml (robot file), .json (model), .urdf, .csv (DH table) or .conf (UR)"
            raise InputError(Problem(str(path), 0, 0, "has a name of no known file type", cure))
    if repeatability is not None:
        if robot.repeatability is not None:
            what = f"says its repeatability: {robot.repeatability:g} mm"
            raise InputError(Problem(str(path), 0, 0, what, "leave --repeatability out"))
        robot = replace(robot, repeatability=repeatability)
    return Source(str(path), robot, RobotDescription.of(model.robot) if model else robot, model)


def _calibrated(path: Path, repeatability: float | None, sheet: Path | None) -> Source:
    if sheet is None:
        what = "is a maker's calibration: it has no limits, and says not of which robot"
        raise InputError(Problem(str(path), 0, 0, what, "give its data sheet's robot file: --robot ur10e"))
    if repeatability is not None:
        raise InputError(Problem("--repeatability", 0, 0, "is that of the robot of --robot", "leave it out"))
    nominal = RobotFile.load(sheet)
    return calibrated_source(str(path), load_calibration(path, nominal), nominal)


def calibrated_source(name: str, found: Calibrated, sheet: RobotFile) -> Source:
    """A robot by its maker's calibration; name: of the file or the controller in errors."""
    apart = f"{found.apart_mm:.3f} mm and {found.apart_deg:.4f}° from the data sheet's axes and flange"
    note = f"the geometry is the maker's calibration of one arm, up to {apart}"
    return Source(name, found.robot, RobotDescription.of(sheet), notes=(note,))


def exported(source: Source, form: str, options: ExportOptions) -> Exported:
    """The robot in `form`; of a model with effects, the geometry nearest to the whole model.

    Raises InputError where the source has no such form.
    """
    if form in (*JOINT_ZEROS, "ur-calibration") or options.into is not None:
        what = f"--to {form}{' --into' if options.into else ''}"
        refuse_prismatic(source.robot.name, prismatic_numbers(source.robot.joints), source.file, what)
    if form in JOINT_ZEROS:
        return _of_joint_zeros(source, form, options)
    effects, assumed = _effects(source.model) if source.model else ([], [])
    fitted = None
    if source.model and effects:
        fitted = fitted_geometry(source.model)
        source = replace(source, robot=RobotDescription.of(source.model.robot, fitted.chain))
    mounting = ["mounting"] if form in _WITHOUT_MOUNTING and source.robot.mounting != "floor" else []
    content, notes, figures = _geometry(source, form, options)
    notes = [*source.notes, *notes]
    if fitted is None:
        return Exported(content, tuple(mounting), None, tuple(notes), figures)
    compared = f"links, base and tool are fitted to the whole model; {_of_nominal(fitted)}"
    notes = [*fitted.warnings, compared, *notes, *assumed]
    return Exported(content, (*mounting, *effects), fitted.cost, tuple(notes), {**figures, **fitted.figures()})


def _of_nominal(fitted: FittedForm) -> str:
    return f"the nominal robot, its base and tool registered, is off by {fitted.nominal.words}"


def _effects(model: ModelFile) -> tuple[list[str], list[str]]:
    """Titles of the effects, which no form has a place for, and which of them the distance from the model lacks."""
    found = effects_left_out(model)
    uncounted = [title for title, counted in found.items() if not counted]
    return list(found), [f"{title} is not in this distance: its conditions are unknown" for title in uncounted]


def _geometry(source: Source, form: str, options: ExportOptions) -> tuple[str | bytes, list[str], dict[str, Any]]:
    """Content, notes and figures of a form that holds the geometry of the links."""
    robot = source.robot
    if form in ROBOT_FILES:
        return robot_text(robot, ROBOT_FILES[form], source.file), [], {}
    if form == "dh-csv":
        own = robot.chain.convention
        return dh_table_text(robot, options.table or ("mdh-hayati" if own == "poe" else own)), [], {}
    if form == "ur-calibration":
        return _ur_calibration(source, options)
    if options.into is None:
        return urdf_text(robot), [], {}
    return _urdf_into(source, options.into, options.tip)


def _urdf_into(source: Source, into: Path, tip: str | None) -> tuple[bytes, list[str], dict[str, Any]]:
    content, lacking = urdf_into(into, source.nominal, source.robot, tip)
    notes = ["base and tool of the fit are not in the URDF: its own stay"]
    return content, [*notes, *([f"the URDF lacks {lacking}"] if lacking else [])], {}


def _ur_calibration(source: Source, options: ExportOptions) -> tuple[str, list[str], dict[str, Any]]:
    own = source.nominal.calibration or source.robot.calibration
    known = hash_of(options.into) if options.into else own.hash if own else None
    found = ur_calibration(source.nominal, source.robot, source.file, known)
    notes = [f"not in this form: the TCP in tool0 is {_words(found.tcp)}; the base is {_words(found.base)}"]
    if known is None:
        notes.append("the hash is not the controller's: the driver will report a mismatch; --into keeps that of a file")
    return found.text, notes, {"tcp_in_tool0": found.tcp.tolist(), "base": found.base.tolist()}


def _of_joint_zeros(source: Source, form: str, options: ExportOptions) -> Exported:
    if source.model is None:
        what = f"is no model: it has no identified joint zeros for --to {form}"
        raise InputError(Problem(source.file, 0, 0, what, "give a model file (.json) of `cellctl fit`"))
    zeros = joint_zeros(source.model)
    notes = [*zeros.form.warnings, _of_nominal(zeros.form)]
    if form == "kuka":
        content = kuka_text(source.robot.name, zeros, options.tool, options.base)
    else:
        content = abb_text(zeros) if form == "abb" else fanuc_text(zeros)
        notes.append(f"the offsets go with the tool {_words(zeros.tool)} and the base {_words(zeros.base)}")
    effects, assumed = _effects(source.model)
    left_out = ("lengths and axes of the links", *effects)
    return Exported(content, left_out, zeros.after, (*notes, *assumed), _figures(zeros))


def _figures(zeros: JointZeros) -> dict[str, Any]:
    return {
        "offsets_deg": zeros.offsets.tolist(),
        "base": zeros.base.tolist(),
        "tool": zeros.tool.tolist(),
        **zeros.form.figures(),
    }


def _words(frame: Floats) -> str:
    xyz = ", ".join(f"{value:.4f}" for value in frame[:3, 3].tolist())
    abc = ", ".join(f"{value:.5f}" for value in abc_from_rotation(frame[:3, :3]).tolist())
    return f"X, Y, Z = {xyz} mm and A, B, C = {abc}°"
