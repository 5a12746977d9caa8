"""Choice of a table's columns by clicks: what each heading means in a data set."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, final

from nicegui import ui
from nicegui.elements.upload_files import FileUpload

from cellctl.console.appearance import Cell, figures, words
from cellctl.pendant_import import FileColumn, columns_of

_JOINTS = {f"A{number}": f"joint {number}" for number in range(1, 9)}
_MEANINGS = {
    **_JOINTS,
    **{axis: f"measured {axis}" for axis in "XYZ"},
    **{f"s{axis}": f"σ of {axis}" for axis in "XYZ"},
    **{name: f"orientation {name}" for name in ("A", "B", "C", "RX", "RY", "RZ", "QW", "QX", "QY", "QZ")},
    "name": "name of the point",
    "set": "set: fit or test",
    "session": "session",
    "temperature": "temperature, °C",
    "payload": "payload, kg",
    "time": "time",
}


async def uploaded_columns(file: FileUpload) -> tuple[FileColumn, ...]:
    """The columns of an uploaded table."""
    with tempfile.TemporaryDirectory(prefix="cellctl-columns-") as folder:
        path = Path(folder) / f"table{Path(file.name).suffix}"
        await file.save(path)
        return await asyncio.to_thread(columns_of, path)


@final
class ColumnPicker:
    """A table of the columns. told: called with the columns that a person named, as `A1=shoulder,X=north`."""

    def __init__(self, told: Callable[[str], object]) -> None:
        self._told = told
        self._chosen: dict[str, str] = {}
        self._place = ui.element("div").classes("wide")

    def show(self, files: Mapping[str, tuple[FileColumn, ...]]) -> None:
        """Show the columns of these files, by name, with a guess of what their headings do not say."""
        self._place.clear()
        self._chosen = {each.heading: each.guess for found in files.values() for each in found if each.guess}
        with self._place:
            for name, found in files.items():
                if found:
                    ui.label(f"Columns of {name}: what does each hold?").classes("section-title")
                    columns = words("Column", "First values", "Holds")
                    figures(columns, [self._row(each) for each in found], label=f"Columns of {name}")
        if self._chosen:
            self._tell()

    def _row(self, column: FileColumn) -> list[Cell]:
        return [column.heading, "  ".join(column.samples), lambda: self._choice(column)]

    def _choice(self, column: FileColumn) -> None:
        known = _MEANINGS.get(column.means, column.means)
        options = {"": f"{known}, as the heading says" if known else "not used", **_MEANINGS}

        def changed(event: Any) -> None:
            self._chosen.pop(column.heading, None)
            if event.value:
                self._chosen[column.heading] = event.value
            self._tell()

        chosen = ui.select(options, value=column.guess, on_change=changed).props("outlined dense options-dense")
        chosen.props["aria-label"] = f"What {column.heading} holds"

    def _tell(self) -> None:
        self._told(",".join(f"{meaning}={heading}" for heading, meaning in self._chosen.items()))
