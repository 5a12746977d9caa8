"""`/analyse/NAME`: what the data were understood as, the fit, its verdict, downloads, compensated programs, report."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, final

from nicegui import events, ui

from cellctl.console import analysis_commands as commands
from cellctl.console.following import follow_event
from cellctl.console.frame import frame, with_operator
from cellctl.console.jobs import Job
from cellctl.console.look import command_button, problem_list, section
from cellctl.console.page_commands import show_problems
from cellctl.console.pages.analyse_parts import (
    Options,
    ProgramOptions,
    downloads,
    headline,
    programs,
    report,
    robot_choice,
    understood,
)
from cellctl.console.pages.import_answers import REPEATABILITY, names_fields
from cellctl.console.pages.uploading import upload_button, upload_of
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.operations import analyses
from cellctl.operations.analyses import FitSettings


@ui.page("/analyse/{name}", response_timeout=10.0)
async def analyse_one(name: str) -> None:
    """One analysis."""
    try:
        state = await asyncio.to_thread(_read, name)
    except InputError as error:
        with frame("Analysis", "/analyse"):
            problem_list(error.problems)
            ui.link("All analyses", "/analyse")
        return
    with frame(state["data"], "/analyse"):
        _Page(name, state)


def _read(name: str) -> dict[str, Any]:
    """State, understanding and figures of an analysis. Raises InputError."""
    folder = analyses.analysis_folder(console().runs, name)
    parts = {"understood": analyses.UNDERSTOOD, "figures": analyses.FIT}
    return {**analyses.state_of(folder), **{key: analyses.read_json(folder / file) for key, file in parts.items()}}


def _nothing() -> None:
    """Nothing to leave."""


@final
class _Page:
    """Follows the jobs of an analysis: progress at once, everything else anew when a job begins or ends."""

    def __init__(self, name: str, state: dict[str, Any]) -> None:
        self._name, self._state = name, state
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
            self._state = await asyncio.to_thread(_read, self._name)
        except InputError:
            return  # deleted by another operator
        self._content.refresh()

    def _show_progress(self) -> None:
        if self._job is not None:
            self._bar.set_value(round(self._job.share, 3))
            self._doing.set_text(f"{100.0 * self._job.share:.0f} %")
            self._step.set_text(self._job.doing or "starting")

    @ui.refreshable_method
    def _content(self) -> None:
        state = self._state
        headline(state, busy=self._job is not None)
        self._progress()
        if state["outcome"] and state["outcome"]["failure"]:
            problem_list(Problem(**each) for each in state["outcome"]["failure"]["problems"])
        if state["files"]:
            downloads(state)
        with ui.element("div").classes("two"):
            understood(state)
            self._choices(state)
        if analyses.MODEL in state["files"]:
            programs(state, self._compensate_field)
            report(state)
        with ui.element("div").classes("row"):
            command_button("Delete this analysis", self._ask_delete, icon="delete", dangerous=True)

    def _progress(self) -> None:
        with ui.element("div").classes("fit-progress").props("role=status") as row:
            self._bar = ui.linear_progress(0.0, show_value=False, size="10px").props('aria-label="Progress"')
            self._doing, self._step = ui.label("0 %"), ui.label("")
        row.set_visibility(self._job is not None)
        self._show_progress()

    def _choices(self, state: dict[str, Any]) -> None:
        busy = self._job is not None
        with section("Robot and fit"):
            robot_choice(state, self._choose_robot, enabled=not busy)
            with ui.element("div").classes("row") as own:
                upload_button("Own robot file or URDF", self._robot_file, self._too_large)
                self._repeatability = ui.input(REPEATABILITY).props("outlined dense").style("min-width: 19rem")
            own.set_visibility(not busy)
            self._options = Options(FitSettings(**state["settings"]))
            with ui.element("div").classes("row"):
                label = "Fit again" if state["outcome"] else "Fit"
                fit = command_button(label, lambda: with_operator(self._fit), icon="play_arrow", important=not busy)
                fit.set_enabled(bool(state["robot"]) and not busy)
                if busy:
                    command_button("Cancel", lambda: with_operator(self._cancel), icon="close")

    def _compensate_field(self) -> None:
        self._program_options = ProgramOptions()
        upload_button("Choose program or targets", self._program, self._too_large)

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
        with ui.dialog() as dialog, ui.card():
            ui.label(f"Delete {self._state['data']} and all results?").classes("section-title")
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
