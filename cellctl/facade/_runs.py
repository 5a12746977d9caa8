"""Runs of campaigns, from their folders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, final

from cellctl.facade._inputs import Data
from cellctl.facade._models import Model
from cellctl.facade._views import bars_before_and_after, html_table, number_cells, soft, verdict_line, view
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import TableFile
from cellctl.journal import JournalError, fold, read_journal, run_place
from cellctl.operations.results import as_json
from cellctl.operations.run_list import run_summary
from cellctl.report import Run as Content
from cellctl.report import render


@final
@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run: its journal, and the files beside it. report: the JSON of `cellctl show`."""

    folder: Path
    report: Mapping[str, Any]
    _content: Content

    @property
    def name(self) -> str:
        """The run's name."""
        return self._content.name

    @property
    def state(self) -> str:
        """`finished`, `failed`, `still running`, …"""
        return str(self.report["state"])

    @property
    def verdict(self) -> str | None:
        """`better`, `no better` or `worse`; None for a run without a verdict."""
        return self.report["verdict"]  # type: ignore[no-any-return]

    @property
    def sentence(self) -> str | None:
        """The verdict with its figures."""
        return self.report["sentence"]  # type: ignore[no-any-return]

    @property
    def before(self) -> Mapping[str, float] | None:
        """Measured held-out errors before compensation, mm: mean, rms, max."""
        return self.report["before"]  # type: ignore[no-any-return]

    @property
    def after(self) -> Mapping[str, float] | None:
        """Measured held-out errors with the table active, mm: mean, rms, max."""
        return self.report["after"]  # type: ignore[no-any-return]

    @cached_property
    def model(self) -> Model | None:
        """The identified robot. report: the fit's figures as the run recorded them."""
        file = self._content.model
        return Model(file, self._content.figures, self.folder / "model.json") if file else None

    @cached_property
    def data(self) -> Data | None:
        """The data set of the run."""
        return Data(self._content.data) if self._content.data else None

    @cached_property
    def table(self) -> TableFile | None:
        """The compensation table. Raises InputError if the file was changed."""
        path = self.folder / "table.json"
        return TableFile.load(path) if path.exists() else None

    def events(self) -> list[dict[str, Any]]:
        """All events of the journal, in order: `seq`, `time_s` (the cell's time), `kind`, the event's own fields."""
        return [
            {"seq": entry.seq, "time_s": entry.time_ns * 1e-9, "kind": entry.event.kind, **asdict(entry.event)}
            for entry in read_journal(self.folder)
        ]

    def page(self, path: str | Path | None = None) -> str:
        """The report of the run as an HTML page, written to `path` if given. Raises OSError."""
        text = render(self._content)
        if path is not None:
            write_atomically(Path(path), text)
        return text

    def __repr__(self) -> str:
        return f"<cellctl run {self.name}: {self.state}, {self.verdict or 'no verdict'}>"

    def _repr_html_(self) -> str:
        parts = [verdict_line(self.sentence, self.verdict or "")] if self.sentence else []
        if self.before and self.after and None not in (self.before["mean"], self.after["mean"]):
            pairs = (("before", self.before), ("after", self.after))
            rows = [[name, *number_cells([errors[key] for key in ("mean", "rms", "max")])] for name, errors in pairs]
            parts += [
                html_table(["measured error, mm", "mean", "RMS", "max"], rows),
                bars_before_and_after(self.before, self.after),
            ]
        facts = [
            f"{self.report['points']} points",
            str(self.report["table_state"] or "no table"),
            str(self.report["began"]),
        ]
        complaints = [soft(words) for words in self._content.complaints]
        return view(f"{self.name}: {self._content.title}, {self.state}", *parts, soft(", ".join(facts)), *complaints)


def open_run(run: str | Path, runs: str | Path = "runs") -> Run:
    """The run in folder `run`, or of that name in the folder `runs`. Raises InputError where there is none, or its
    journal cannot be read.
    """
    place = run_place(Path(run), Path(runs))
    try:
        content = Content.load(place)
        return Run(content.folder, as_json(run_summary(content.folder, fold(read_journal(place)))), content)
    except JournalError as error:
        raise InputError(Problem(str(error.path), 0, 0, error.what, error.cure)) from error
