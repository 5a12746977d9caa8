"""Reads the model that an earlier run identified, and refuses one that is not of the cell's robot and tool."""

from __future__ import annotations

from pathlib import Path

from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile, RobotFile
from cellctl.formats.prior import another_robot
from cellctl.formats.robot import Tool
from cellctl.journal import run_place
from cellctl.operations.learnt_on import learnt_on
from cellctl.procedure import StepContext
from procedures.steps.tracker.rows import MODEL_FILE, ReadModelRow


def read_model_of(context: StepContext, run: str, file: str = "") -> ReadModelRow:
    """The model of the run in folder `run`, or of that name beside this run; or the model in `file`.

    Raises InputError without one, and with every reason why it is not of the cell's robot: another controller, another
    robot, another tool.
    """
    if run and file:
        what = "a run and a model file are named, and one model compensates"
        raise InputError(Problem("--set model_file", 0, 0, what, "name the run or the file"))
    path = Path(file) if file else run_place(Path(run), context.run_folder.parent) / "model.json"
    model = ModelFile.load(path)
    found = learnt_on(path, model, None)
    problems = [*_another_controller(path, found.serial, context.identity("robot").serial)]
    problems += _another_robot(path, model, RobotFile.load(context.robot_file))
    if problems:
        raise InputError(problems)
    return ReadModelRow(run=found.run or path.stem, serial=found.serial, text=path.read_text(encoding="utf-8"))


def read_model(context: StepContext) -> ModelFile | None:
    """The model that this run read, from its run folder; None without one."""
    read = context.recorded(ReadModelRow)
    return ModelFile.load(context.run_folder / MODEL_FILE) if read else None


def _another_controller(path: Path, theirs: str, own: str) -> list[Problem]:
    if theirs == own:
        return []
    what = f"was identified on controller '{theirs}', and this one is '{own}'"
    return [Problem(str(path), 0, 0, what, "name a run on this robot")]


def _another_robot(path: Path, model: ModelFile, robot: RobotFile) -> list[Problem]:
    """Another link table; or another tool, of which the model, older than it, knows nothing."""
    problems = another_robot(model.robot, robot, str(path))
    if model.robot.name != robot.name:
        what = f"is a model of a '{model.robot.name}', and the cell's robot file says '{robot.name}'"
        problems.append(Problem(str(path), 0, 0, what, "name a model of this robot"))
    if model.robot.tool != robot.tool:
        what = (
            f"was identified with the tool {_words(model.robot.tool)}, and the cell's robot file has "
            f"{_words(robot.tool)}: the model is older than the tool, or of another one"
        )
        cure = "identify again with this tool, or correct `tool:` in the robot file"
        problems.append(Problem(str(path), 0, 0, what, cure))
    return problems


def _words(tool: Tool) -> str:
    xyz, abc = (", ".join(f"{value:g}" for value in part) for part in (tool.xyz, tool.abc))
    return f"({xyz}) mm, ({abc})°, {tool.mass:g} kg"
