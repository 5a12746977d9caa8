"""Fields for files: a zone to drop them, and a button."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui
from nicegui.elements.upload_files import FileUpload

from cellctl.console.analysis_commands import Upload
from cellctl.console.guarding import LARGEST_BODY
from cellctl.console.look import command_button

Handler = Callable[..., Any]


def drop_zone(title: str, note: str, on_files: Handler, on_rejected: Handler) -> ui.upload:
    """A zone to drop files; its button opens the file dialog. All files dropped together arrive in one call."""
    zone = _uploader(on_files, on_rejected).classes("drop")
    with zone.add_slot("header"), ui.element("div").classes("inner"):
        ui.icon("upload_file", size="2.2rem").props("aria-hidden=true")
        ui.label(title).classes("title")
        ui.label(note).classes("note").style("max-width: 46rem")
        _choose(zone, "Choose files")
    return zone


def upload_button(text: str, on_files: Handler, on_rejected: Handler) -> ui.upload:
    """A button that opens the file dialog."""
    zone = _uploader(on_files, on_rejected).classes("quiet-upload")
    with zone.add_slot("header"):
        _choose(zone, text)
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


def _choose(zone: ui.upload, text: str) -> None:
    ui.element("q-uploader-add-trigger").style("display: none")  # the file field that `pickFiles` opens
    button = command_button(text, lambda: None, icon="folder_open")
    button.on("click", js_handler=f"() => getElement({zone.id}).$refs.qRef.pickFiles()")
