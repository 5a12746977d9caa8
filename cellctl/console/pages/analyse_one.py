"""`/analyse/NAME`: what the data were understood as, the fit, its verdict, downloads, compensated programs, report."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any, final

from nicegui import events, ui

from cellctl.console import analysis_commands as commands
from cellctl.console.appearance import (
    Cell,
    command_button,
    facts,
    figures,
    link_button,
    numbers,
    problem_list,
    section,
    state_word,
    why_not,
    words,
)
from cellctl.console.frame import enable, follow_event, frame, not_there, show_problems, with_operator
from cellctl.console.jobs import Job
from cellctl.console.pages.analyse import REPEATABILITY, STATES, names_fields, upload_button, upload_of
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.installed import shipped
from cellctl.operations import analyses
from cellctl.operations.analyses import RESULTS, AnalysisState, FitSettings, ProgramEntry, TargetsEntry, Understanding
from cellctl.report.figures import fixed

MODELS = {
    "auto": "chosen by held-out rows (auto)",
    "geometry": "geometry: links, joint zeros, tool",
    "geometry+compliance": "geometry and flexible joints",
    "zeros": "joint zeros only",
    "registration": "base and tool only",
}
JUDGING = {
    "": "column set, else five parts",
    "0.2": "20 % of the rows, at random",
    "0.3": "30 % of the rows, at random",
    "0.5": "half of the rows, at random",
    "session": "each session in turn",
}
_LISTED = 200


@final
@dataclass(frozen=True)
class Shown:
    """An analysis as its page shows it. figures: of the fit, as `cellctl fit --json` has them."""

    state: AnalysisState
    understood: Understanding | None
    figures: dict[str, Any] | None


def headline(shown: Shown, *, busy: bool) -> None:
    """The verdict in one sentence, and the figures before and after."""
    state = shown.state
    outcome, found = state.outcome, shown.understood
    if busy:
        state_word("working", "At work", large=True)
    elif outcome and outcome.verdict:
        first, _, rest = outcome.sentence.partition(". ")
        kind, word = STATES[outcome.verdict]
        state_word(kind, f"{word.capitalize()}. {first}.", large=True)
        with ui.element("div").classes("two"):
            if shown.figures:
                _errors(shown.figures)
            ui.label(rest.replace("Better than nominal. ", "")).classes("note").style("max-width: 50rem")
    elif state.state == "new" and found and found.data.problems:
        state_word("bad", "The data and the robot file do not go together", large=True)
    elif state.state == "new" and found and found.doubt:
        state_word("warning", "Read, but hardly of this robot", large=True)
    elif state.state == "new" and state.robot:
        state_word("good", "Read and understood: ready to fit", large=True)
    elif state.state == "new":
        state_word("waiting", "Read: choose the robot", large=True)
    else:
        kind, word = STATES[state.state]
        state_word(kind, word.capitalize(), large=True)


def _errors(found: dict[str, Any]) -> None:
    """Mean, RMS and maximum, held-out rows before and after."""
    tested = f"{found['n_test']} held-out rows"
    shown = {
        f"{tested}, nominal": found["nominal"],
        f"{tested}, identified": found["test"],
        f"{found['n_fit']} rows of the fit, identified": found["fit"],
    }
    columns = [*words("Distance from the measured place"), *numbers("mean, mm", "RMS, mm", "max, mm")]
    rows = [[name, *(fixed(values[key]) for key in ("mean", "rms", "max"))] for name, values in shown.items()]
    figures(columns, rows, label="Errors")


def understood(found: Understanding | None) -> None:
    """What the data were understood as; problems, rejected rows, decisions of an import."""
    with section("What was understood"):
        if found is None:
            ui.label("Not read yet.").classes("note")
            return
        data = found.data
        facts(list(data.words()))
        if found.doubt:
            state_word("warning", found.doubt).label.style("white-space: normal")
        if data.problems:
            problem_list(data.problems)
            if data.note:
                ui.label(data.note).classes("note")
        if found.candidate:
            state_word("warning", f"If it is a {found.candidate.robot}:").label.style("white-space: normal")
            problem_list(found.candidate.problems)
        _listed("How the files were read", data.decided)
        rejected = [f"{row.get('file', data.file)}:{row['line']}: {row['reason']}" for row in data.rejected]
        _listed(f"Rows that cannot be used: {len(rejected)}", rejected)


def _listed(title: str, lines: Sequence[str]) -> None:
    if not lines:
        return
    with (
        ui.expansion(title).props("dense").classes("unfolding").style("width: 100%"),
        ui.element("ul").classes("short-list mono"),
    ):
        for line in lines[:_LISTED]:
            with ui.element("li"):
                ui.label(line)
        if len(lines) > _LISTED:
            with ui.element("li"):
                ui.label(f"… and {len(lines) - _LISTED} more")


def robot_choice(shown: Shown, choose: Callable[[str], Awaitable[None]], *, enabled: bool) -> None:
    """The robot of the library with search, and the suggestion."""
    state, found = shown.state, shown.understood.suggestions if shown.understood else None
    titles = {each.name: f"{each.robot} ({each.name})" for each in (found.robots if found else ())}
    options = {**{name: titles[name] for name in titles}, **{name: titles.get(name, name) for name in shipped("robot")}}
    label = "Robot of the library (type to search)"
    if state.robot and not state.library:
        ui.label(f"Own robot file: {state.robot}")
        label = f"{label} in its place"

    async def chosen(event: Any) -> None:
        if event.value and event.value != state.library:
            await choose(event.value)

    field = ui.select(options, label=label, with_input=True, value=state.library or None, on_change=chosen)
    field.props("outlined dense").style("max-width: 28rem").set_enabled(enabled and not why_not("choose robot"))
    if found:
        ui.label(found.sentence).classes("note")


@final
class Options:
    """The options of a fit, hidden until they are wanted."""

    def __init__(self, given: FitSettings) -> None:
        how = given.by or (f"{given.holdout:g}" if given.holdout else "")
        with (
            ui.expansion("Options").props("dense").classes("unfolding").style("width: 100%"),
            ui.element("div").classes("answers"),
        ):
            self._model = ui.select(_with(MODELS, given.model), value=given.model, label="Model").props(
                "outlined dense"
            )
            judged = "Rows held out for the verdict"
            self._how = ui.select(_with(JUDGING, how), value=how, label=judged).props("outlined dense")
            self._seed = ui.number("Seed of the random choice", value=given.seed, min=0, precision=0)
            self._seed.props("outlined dense")
            self._check = ui.checkbox("Check for set-up errors first", value=given.check)

    def settings(self) -> FitSettings:
        """The options as chosen."""
        how = str(self._how.value or "")
        share = float(how) if how.replace(".", "", 1).isdigit() else None
        return FitSettings(
            model=str(self._model.value),
            holdout=share,
            by=how if how and share is None else None,
            seed=int(self._seed.value or 0),
            check=bool(self._check.value),
        )


@final
class ProgramOptions:
    """What a program may leave open."""

    def __init__(self) -> None:
        with (
            ui.expansion("Options").props("dense").classes("unfolding").style("width: 100%"),
            ui.element("div").classes("answers"),
        ):
            self._tool = ui.input("Tool X,Y,Z,A,B,C (without $config.dat)").props("outlined dense")
            self._base = ui.input("Base X,Y,Z,A,B,C (without $config.dat)").props("outlined dense")
            self._arm = ui.checkbox("Another tool: correct the arm only")
            self._insert = ui.checkbox("Add points on LIN and CIRC that leave 0.05 mm")

    def request(self) -> dict[str, Any]:
        """The options as chosen."""
        texts = {"tool": self._tool.value.strip(), "base": self._base.value.strip()}
        return {**texts, "arm_only": bool(self._arm.value), "insert": bool(self._insert.value)}


def downloads(state: AnalysisState) -> None:
    """Links to the results, and what a URDF cannot hold."""
    with ui.element("div").classes("row"):
        for file in state.files:
            link_button(f"Download {RESULTS[file]}", _file(state, file), icon="download", download=True)
        link_button("Download data set", _file(state, state.dataset), icon="download", download=True)
    for note in state.outcome.notes if state.outcome else ():
        ui.label(note).classes("note")


def programs(state: AnalysisState, field: Callable[[], None]) -> None:
    """A field for a program, and the programs compensated so far."""
    with section("Compensate a program"):
        ui.label(
            "A KRL program (.src, with its .dat and $config.dat) or a URScript program (.script), or targets as CSV "
            "(X, Y, Z, A, B, C in the frame of "
            "the measurements) or of a RAPID, FANUC or UR program. Only for points made off-line: points taught by "
            "hand with this robot contain its error already."
        ).classes("note").style("max-width: 60rem")
        field()
        if state.programs:
            columns = [*words("Program"), *numbers("points", "left as they were", "predicted before, mean, mm")]
            columns += [*numbers("after, mean, mm", "after, max, mm"), *words("Download")]
            figures(columns, [_program(state, each) for each in reversed(state.programs)], label="Programs")
            left = [f"{one.file}:{one.line}: {one.name}: {one.reason}" for each in state.programs for one in each.left]
            _listed(f"Points left as they were: {len(left)}", left)


def _program(state: AnalysisState, each: ProgramEntry | TargetsEntry) -> list[Cell]:
    def files() -> None:
        with ui.element("div").classes("row"):
            for file in each.files:
                place = f"/api/analyses/{state.name}/programs/{each.id}/{file}"
                link_button(file, place, icon="download", download=True)

    before, after = each.predicted
    counts = (str(each.compensated), str(len(each.left)))
    return [each.name, *counts, *map(fixed, (before["mean"], after["mean"], after["max"])), files]


def report(state: AnalysisState) -> None:
    """The report of the fit in a frame."""
    place = f"/api/analyses/{state.name}/report"
    with section("Report"):
        ui.link("Open it alone, to print it", place, new_tab=True)
        ui.element("iframe").props(f'src="{place}" title="Report of the fit"').classes("report-frame")


def _file(state: AnalysisState, file: str) -> str:
    return f"/api/analyses/{state.name}/files/{file}"


def _with(options: dict[str, str], value: str) -> dict[str, str]:
    """The options, and the value that was chosen elsewhere."""
    return options if value in options else {**options, value: value}


@ui.page("/analyse/{name}", response_timeout=10.0)
async def analyse_one(name: str) -> None:
    """One analysis."""
    try:
        shown = await asyncio.to_thread(_read, name)
    except InputError as error:
        with frame("Analysis", "/analyse"):
            not_there(error.problems)
            ui.link("All analyses", "/analyse")
        return
    with frame(shown.state.data, "/analyse"):
        _Page(name, shown)


def _read(name: str) -> Shown:
    """State, understanding and figures of an analysis. Raises InputError."""
    folder = analyses.analysis_folder(console().runs, name)
    figures = analyses.read_json(folder / analyses.FIT)
    return Shown(analyses.state_of(folder), analyses.understanding(folder), figures)


def _nothing() -> None:
    """Nothing to leave."""


@final
class _Page:
    """Follows the jobs of an analysis: progress at once, everything else anew when a job begins or ends."""

    def __init__(self, name: str, shown: Shown) -> None:
        self._name, self._shown = name, shown
        self._job = commands.job_of(name)
        self._shown_job = self._job
        self._problems = ui.element("div").classes("when-filled")
        self._content()
        follow_event(self._follow, self._subscribe, f"analysis {name}")

    def _subscribe(self, changed: Callable[[], None]) -> Callable[[], None]:
        """For each change of a job of this analysis."""
        leave_job = self._job.subscribe(changed) if self._job else _nothing

        def begun(job: Job) -> None:
            nonlocal leave_job
            if job.target == self._name and job is not self._job and not job.ended_already:
                leave_job()
                self._job, leave_job = job, job.subscribe(changed)
                changed()

        leave_jobs = console().jobs.subscribe(begun)

        def leave() -> None:
            leave_job()
            leave_jobs()

        return leave

    async def _follow(self) -> None:
        """Show the change of the job; the page anew when it begins and when it has ended."""
        job = self._job
        if job is not None and job.ended_already:
            self._job = self._shown_job = None
            await self._anew()
        elif job is not self._shown_job:
            self._shown_job = job
            await self._anew()
        self._show_progress()

    async def _anew(self) -> None:
        try:
            self._shown = await asyncio.to_thread(_read, self._name)
        except InputError:
            return  # deleted by another operator
        self._content.refresh()

    def _show_progress(self) -> None:
        if self._job is not None:
            self._bar.set_value(round(self._job.share, 3))
            percent = f"{100.0 * self._job.share:.0f} %"
            self._doing.set_text(", ".join(filter(None, (percent, self._job.time_left))))
            self._step.set_text(self._job.doing or "starting")

    @ui.refreshable_method
    def _content(self) -> None:
        shown, state = self._shown, self._shown.state
        headline(shown, busy=self._job is not None)
        self._progress()
        if state.outcome and state.outcome.failure:
            problem_list(state.outcome.failure.problems)
        if state.files:
            downloads(state)
        with ui.element("div").classes("two"):
            understood(shown.understood)
            self._choices(shown)
        if analyses.MODEL in state.files:
            programs(state, self._compensate_field)
            report(state)
        with ui.element("div").classes("row"):
            command_button("Delete this analysis", self._ask_delete, icon="delete", dangerous=True, gives="delete")

    def _progress(self) -> None:
        with ui.element("div").classes("fit-progress").props("role=status") as row:
            self._bar = ui.linear_progress(0.0, show_value=False, size="10px").props('aria-label="Progress"')
            self._doing, self._step = ui.label("0 %"), ui.label("")
        row.set_visibility(self._job is not None)
        self._show_progress()

    def _choices(self, shown: Shown) -> None:
        state = shown.state
        busy = self._job is not None
        with section("Robot and fit"):
            robot_choice(shown, self._choose_robot, enabled=not busy)
            with ui.element("div").classes("row") as own:
                upload_button("Own robot file or URDF", "choose robot", self._robot_file, self._too_large)
                self._repeatability = ui.input(REPEATABILITY).props("outlined dense").style("min-width: 19rem")
            own.set_visibility(not busy)
            self._options = Options(state.settings)
            with ui.element("div").classes("row"):
                label = "Fit again" if state.outcome else "Fit"
                fit = command_button(
                    label, lambda: with_operator(self._fit), icon="play_arrow", important=not busy, gives="fit"
                )
                enable(fit, bool(state.robot) and not busy)
                if busy:
                    command_button("Cancel", lambda: with_operator(self._cancel), icon="close", gives="cancel")

    def _compensate_field(self) -> None:
        self._program_options = ProgramOptions()
        upload_button("Choose program or targets", "compensate", self._program, self._too_large)

    async def _fit(self, here: Operator) -> None:
        await self._try(lambda: commands.start_fit(here, self._name, self._options.settings()))

    async def _cancel(self, here: Operator) -> None:
        await self._try(lambda: commands.cancel(here, self._name))

    async def _choose_robot(self, name: str) -> None:
        await with_operator(lambda here: self._try(lambda: commands.choose_robot(here, self._name, name)))

    async def _robot_file(self, event: events.MultiUploadEventArguments) -> None:
        file, repeatability = upload_of(event.files[0]), str(self._repeatability.value or "").strip()
        await with_operator(
            lambda here: self._try(lambda: commands.choose_robot(here, self._name, "", file, repeatability))
        )

    async def _program(self, event: events.MultiUploadEventArguments) -> None:
        files = [upload_of(file) for file in event.files]
        request = self._program_options.request()
        await with_operator(lambda here: self._try(lambda: commands.compensate(here, self._name, files, request)))

    def _ask_delete(self) -> None:
        with ui.dialog().props('aria-label="Delete this analysis"') as dialog, ui.card():
            ui.label(f"Delete {self._shown.state.data} and all results?").classes("section-title")
            ui.label("Model, report and compensated programs of this analysis are removed from this computer.")
            with ui.element("div").classes("row"):

                async def delete() -> None:
                    dialog.close()
                    await with_operator(self._delete)

                command_button("Delete", delete, dangerous=True)
                command_button("Keep", dialog.close)
        dialog.open()

    async def _delete(self, here: Operator) -> None:
        async def work() -> None:
            await commands.delete(here, self._name)
            ui.navigate.to("/analyse")

        await self._try(work)

    def _too_large(self) -> None:
        self._show([Problem("upload", 0, 0, "is too large", "the whole upload may have 20 MB")])

    async def _try(self, work: Callable[[], Awaitable[Any]]) -> None:
        """Do `work`; its problems are shown."""
        self._problems.clear()
        try:
            await work()
        except InputError as error:
            self._show([names_fields(problem) for problem in error.problems])

    def _show(self, problems: list[Problem]) -> None:
        show_problems(self._problems, problems)
