"""`/analyse`: drop a data file, answer what it leaves open; the analyses of this folder."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any, final

from nicegui import events, ui
from nicegui.elements.upload_files import FileUpload

from cellctl.console import analysis_commands as commands
from cellctl.console.analysis_commands import Upload
from cellctl.console.appearance import Cell, State, command_button, figures, section, shown_time, state_word, words
from cellctl.console.frame import Commands, TokenDialog, follow_event, frame, operator, show_problems
from cellctl.console.guarding import LARGEST_BODY
from cellctl.console.pages.import_columns import ColumnPicker, uploaded_columns
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.installed import shipped
from cellctl.operations import analyses
from cellctl.operations.analyses import AnalysisState, Outcome, roles

Handler = Callable[..., Any]

_CHOICES = {
    "unit": ("Unit of X, Y, Z", ["", "mm", "m", "cm", "um", "inch"]),
    "angles": ("Unit of the joints", ["", "deg", "rad"]),
    "decimal": ("Decimal sign", ["", "point", "comma"]),
    "pair": ("Pair two files by", ["", "name", "order"]),
    "orientation": ("Orientations are", ["", "abc", "quaternion", "fixed-xyz", "euler-xyz", "rotation-vector"]),
    "j3": ("Third joint counts from (FANUC)", ["", "horizontal", "arm"]),
}
_ROBOT = "Robot of the library"
_COLUMNS = "Columns of the file"
REPEATABILITY = "Repeatability of a URDF's robot, mm"
_LABELS = {name: label for name, (label, _) in _CHOICES.items()}

STATES: dict[str, tuple[State, str]] = {
    "better": ("good", "better than nominal"),
    "no better": ("warning", "no better than nominal"),
    "worse": ("bad", "worse than nominal"),
    "new": ("off", "not fitted yet"),
    "running": ("working", "fitting"),
    "failed": ("bad", "not fitted: input refused"),
    "cancelled": ("off", "cancelled"),
    "cut off": ("warning", "cut off"),
}
"""Word of each verdict, and of each state without one."""

_EXAMPLE = """A1,A2,A3,A4,A5,A6,X,Y,Z
20.0,-70.0,80.0,10.0,50.0,30.0,1090.37,-460.32,439.12
-35.5,-62.1,71.4,0.0,48.2,90.0,812.04,604.77,512.90"""


def drop_zone(title: str, note: str, on_files: Handler, on_rejected: Handler) -> ui.upload:
    """A zone to drop files; its button opens the file dialog. All files dropped together arrive in one call."""
    zone = _uploader(on_files, on_rejected).classes("drop")
    with zone.add_slot("header"), ui.element("div").classes("inner"):
        ui.icon("upload_file", size="2.2rem").props("aria-hidden=true")
        ui.label(title).classes("title")
        ui.label(note).classes("note").style("max-width: 46rem")
        _choose(zone, "Choose files", "upload")
    return zone


def upload_button(text: str, gives: str, on_files: Handler, on_rejected: Handler) -> ui.upload:
    """A button that opens the file dialog, for the command `gives`."""
    zone = _uploader(on_files, on_rejected).classes("quiet-upload")
    with zone.add_slot("header"):
        _choose(zone, text, gives)
    return zone


def upload_of(file: FileUpload) -> Upload:
    """A file of the browser for the commands."""
    return Upload(file.name, file.save)


def _uploader(on_files: Handler, on_rejected: Handler) -> ui.upload:
    return ui.upload(
        multiple=True,
        auto_upload=True,
        max_total_size=LARGEST_BODY,
        on_multi_upload=on_files,
        on_rejected=on_rejected,
    )


def _choose(zone: ui.upload, text: str, gives: str) -> None:
    ui.element("q-uploader-add-trigger").style("display: none")  # the file field that `pickFiles` opens
    button = command_button(text, lambda: None, icon="folder_open", gives=gives)
    button.on("click", js_handler=f"() => getElement({zone.id}).$refs.qRef.pickFiles()")


_LABELS |= {"robot": _ROBOT, "columns": _COLUMNS, "repeatability": REPEATABILITY}
_OPTION = re.compile(rf"--({'|'.join(_LABELS)})\b(?: MM\b)? *")


@final
class ImportAnswers:
    """The fields. `again`: reads the files again with these answers; its button appears once a file was refused."""

    def __init__(self, again: Callable[[], Any]) -> None:
        self._fields: dict[str, Any] = {}
        title = "Answers to questions of an import"
        self._all = ui.expansion(title).props("dense").classes("unfolding").style("width: 100%")
        with self._all:
            ui.label("Only for what the file leaves open.").classes("note")
            self.columns = ColumnPicker(lambda text: self._fields["columns"].set_value(text))
            with ui.element("div").classes("answers"):
                for name, (label, options) in _CHOICES.items():
                    self._fields[name] = ui.select(options, value="", label=label).props("outlined dense")
                robots = ui.select(["", *shipped("robot")], value="", label=_ROBOT, with_input=True)
                self._robot = robots.props("outlined dense")
                columns = ui.input(_COLUMNS, placeholder="A1=shoulder,A2=upper_arm,X=north").classes("wide")
                self._fields["columns"] = columns.props("outlined dense")
                self._fields["repeatability"] = ui.input(REPEATABILITY).props("outlined dense")
            self._again = command_button("Read the file again", again, icon="replay")
        self._again.set_visibility(False)

    @property
    def robot(self) -> str:
        """Name of the robot in the library; empty: not stated."""
        return str(self._robot.value or "")

    def texts(self) -> dict[str, str]:
        """The answers by option; those that are not stated are absent."""
        return {name: str(field.value).strip() for name, field in self._fields.items() if field.value}

    def ask(self) -> None:
        """Show the fields, and the button that reads the files again."""
        self._all.set_value(True)
        self._again.set_visibility(True)


def names_fields(problem: Problem) -> Problem:
    """The problem with the labels of the fields in place of options of the command line."""
    file, what, cure = (
        _OPTION.sub(lambda found: f"‘{_LABELS[found[1]]}’ ", text).strip()
        for text in (problem.file, problem.what, problem.cure)
    )
    return replace(problem, file=file, what=what, cure=cure)


@ui.page("/analyse", response_timeout=10.0)
async def analyse() -> None:
    """Upload, and the list of analyses."""
    found = await asyncio.to_thread(analyses.analyses, console().runs)
    with frame("Analyse a data file", "/analyse"):
        ui.label(
            "Joints and measured points of a robot, from a tracker, a probe or a list typed by hand: see how accurate "
            "the robot is, identify it, and take model, URDF and compensated programs away. No cell is needed."
        ).style("max-width: 60rem")
        _UploadPart()
        _Example()
        with section("Analyses of this folder"):
            _List(found)


class _UploadPart:
    """Drop zone, answers to an import's questions, and what was refused."""

    def __init__(self) -> None:
        self._files: dict[str, FileUpload] = {}
        self._asked = False
        self._place = ui.column().classes("w-full").style("width: 100%; gap: .75rem")
        with self._place:
            self._zone = ui.element("div").style("width: 100%")
            self._busy = ui.element("div").classes("row").props("role=status")
            self._problems = ui.element("div").classes("when-filled")
            self._answers = ImportAnswers(self._read)
            _what_it_must_hold()
        self._busy.set_visibility(False)
        with self._busy:
            ui.spinner(size="1.4em")
            self._doing = ui.label()
        self._show_zone()

    def _show_zone(self, _: Any = None) -> None:
        self._zone.clear()
        with self._zone:
            if operator() is None:
                _ask_for_token(self._show_zone)
            else:
                self._upload = drop_zone(
                    "Drop a data file here",
                    "A data set or a table with joints and positions (CSV, text or Excel workbook), or a robot program "
                    "and its table of positions together. A robot file (YAML or URDF) and an artefact file (YAML) may "
                    f"come along. At most {LARGEST_BODY // 1_000_000} MB.",
                    self._uploaded,
                    self._too_large,
                )

    async def _uploaded(self, event: events.MultiUploadEventArguments) -> None:
        self._files = {file.name: file for file in event.files}
        self._answers.columns.show({})
        self._asked = False
        await self._read()

    async def _read(self) -> None:
        here, files = operator(), self._files
        if here is None:
            return
        self._problems.clear()
        self._doing.set_text(f"Reading {', '.join(files)}: 5 to 20 seconds …")
        self._busy.set_visibility(True)
        try:
            found = roles({name: await _head(file) for name, file in files.items()})
            others = {str(role): upload_of(files[name]) for role, name in found.items() if role != "data"}
            library = "" if "robot" in others else self._answers.robot
            name = await commands.upload(here, upload_of(files[found["data"]]), others, library, self._answers.texts())
            ui.navigate.to(f"/analyse/{name}")
        except InputError as error:
            self._refused([names_fields(problem) for problem in error.problems])
            await self._ask()
        finally:
            self._busy.set_visibility(False)
            self._upload.reset()

    async def _ask(self) -> None:
        """Show the fields, and for the first refusal of these files their columns."""
        if not self._asked:
            tables = [
                file for name, file in self._files.items() if not name.lower().endswith((".yaml", ".yml", ".urdf"))
            ]
            self._answers.columns.show({file.name: await uploaded_columns(file) for file in tables})
            self._asked = True
        self._answers.ask()

    def _too_large(self) -> None:
        cure = "leave rows out, or fit it on the command line, which reads files of any size"
        self._refused([Problem("upload", 0, 0, f"is larger than {LARGEST_BODY / 1e6:g} MB", cure)])

    def _refused(self, problems: list[Problem]) -> None:
        show_problems(self._problems, problems)


class _Example:
    """One click analyses simulated data."""

    def __init__(self) -> None:
        with ui.element("div").classes("row"):
            self._button = command_button(
                "Try it with simulated data", lambda: self._commands.give(self._load), gives="upload"
            )
            ui.label("100 positions of a simulated KUKA KR5 R1400 with errors of its own: no real robot.").classes(
                "note"
            )
            self._busy = ui.spinner(size="1.4em")
        self._busy.set_visibility(False)
        self._commands = Commands()

    async def _load(self, here: Operator) -> None:
        self._busy.set_visibility(True)
        try:
            ui.navigate.to(f"/analyse/{await commands.example(here)}")
        finally:
            self._busy.set_visibility(False)


def _ask_for_token(then: Any) -> None:
    with ui.element("div").classes("drop"), ui.element("div").classes("inner"):
        ui.label("To upload a file, give the console's token").classes("title")
        command_button("Give commands", lambda: TokenDialog(then).open(), important=True)


def _what_it_must_hold() -> None:
    with ui.expansion("What a data file holds").props("dense").classes("unfolding").style("width: 100%"):
        ui.label(
            "One row for each measurement: joints A1 … An in degrees (or q1 … qn in radians) and X, Y, Z in mm as the "
            "instrument states them. In place of X, Y, Z: sphere, socket or plane for touches at fixed places. σ, "
            "session, temperature, payload and set (fit or test) are optional. Base and tool need not be known."
        ).classes("note")
        ui.label(_EXAMPLE).classes("mono").style("white-space: pre; overflow-x: auto")


class _List:
    """The analyses, read again when a job begins or ends."""

    def __init__(self, found: list[AnalysisState]) -> None:
        self._found = found
        self._shown()
        follow_event(self._read, lambda changed: console().jobs.subscribe(lambda _: changed()), "analyses")

    async def _read(self) -> None:
        found = await asyncio.to_thread(analyses.analyses, console().runs)
        if found != self._found:
            self._found = found
            self._shown.refresh()

    @ui.refreshable_method
    def _shown(self) -> None:
        _table(self._found)


def _table(found: list[AnalysisState]) -> None:
    if not found:
        ui.label("None yet.").classes("note")
        return
    columns = words("Data file", "Robot", "State", "Result", "Uploaded", "By")
    figures(columns, map(_row, found), label="Analyses")


def _row(each: AnalysisState) -> list[Cell]:
    outcome = each.outcome
    state, word = STATES[(outcome.verdict if outcome else "") or each.state]
    return [
        lambda: ui.link(each.data, f"/analyse/{each.name}"),
        each.library or each.robot or "–",
        lambda: state_word(state, word),
        result_words(outcome) if outcome else "",
        shown_time(each.created),
        each.operator,
    ]


def result_words(outcome: Outcome) -> str:
    """The first sentence of a verdict, or the first problem."""
    problems = outcome.failure.problems if outcome.failure else ()
    return outcome.sentence.split(". ")[0] or (problems[0].what if problems else "")


async def _head(file: Any) -> str:
    async for part in file.iterate(chunk_size=65536):
        return bytes(part).decode(errors="replace")
    return ""
