"""The tables of the index, and what they hold of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

from sqlalchemy import Boolean, Column, Float, Index, Integer, MetaData, String, Table

VERSION: Final = 3
"""Counts changes of the tables. An index of another version is made anew."""

APPLICATION_ID: Final = 0x43454C49
"""`CELI`: marks an SQLite file as an index of runs."""

METADATA: Final = MetaData()

_TEXT: Final = String().with_variant(String(collation="C"), "postgresql")
"""Compared byte by byte on every database, so that instants in ISO 8601 are in their order."""


def _text(name: str, *, key: bool = False) -> Column[str]:
    return Column(name, _TEXT, primary_key=key, nullable=False)


PLACES = Table(
    "places",
    METADATA,
    _text("place", key=True),
    _text("names"),
    _text("looked"),
)
"""Folders of runs. place: `.` for that of the index itself, else host and folder. names: digest of the names of all
folders in it when all were indexed. looked: when every journal was last compared with its row, UTC, ISO 8601."""

RUNS = Table(
    "runs",
    METADATA,
    _text("place", key=True),
    _text("run", key=True),
    _text("fingerprint"),
    Column("settled", Boolean, nullable=False),
    Column("present", Boolean, nullable=False),
    _text("identity"),
    _text("began_as"),
    _text("began"),
    _text("ended"),
    _text("state"),
    _text("verdict"),
    _text("procedure"),
    _text("robot_type"),
    _text("serial"),
    _text("site"),
    _text("cell"),
    _text("operator"),
    Column("simulated", Boolean, nullable=False),
    Column("points", Integer),
    Column("before_mm", Float),
    Column("after_mm", Float),
    _text("acceptance"),
    _text("table_state"),
    _text("process"),
    Column("has_model", Boolean, nullable=False),
    _text("nominal"),
    Column("due_days", Float),
    _text("words"),
)

CONTENTS = Table("contents", METADATA, _text("place", key=True), _text("run", key=True), _text("json"))
"""The summary of each run as JSON, apart from the columns that searches read."""

PARAMETERS = Table(
    "parameters",
    METADATA,
    _text("place", key=True),
    _text("run", key=True),
    _text("name", key=True),
    _text("unit"),
    Column("value", Float, nullable=False),
    Column("sigma", Float, nullable=False),
    Column("prior_sigma", Float, nullable=False),
)

HISTORIES = Table(
    "histories",
    METADATA,
    _text("place", key=True),
    _text("run", key=True),
    _text("history", key=True),
    _text("series"),
    _text("title"),
    _text("began"),
    _text("json"),
)

VERSIONS = Table("index_version", METADATA, Column("version", Integer, primary_key=True))

Index("runs_by_begin", RUNS.c.place, RUNS.c.began, RUNS.c.run)
Index("runs_unsettled", RUNS.c.place, RUNS.c.settled)
Index("runs_by_identity", RUNS.c.identity)
Index("runs_by_serial", RUNS.c.place, RUNS.c.serial, RUNS.c.began)
Index("runs_by_cell", RUNS.c.place, RUNS.c.cell, RUNS.c.began)
for _name in ("state", "verdict", "procedure"):
    Index(f"runs_by_{_name}", RUNS.c.place, RUNS.c[_name])
Index("histories_by_series", HISTORIES.c.place, HISTORIES.c.history, HISTORIES.c.series, HISTORIES.c.began)


@final
@dataclass(frozen=True, slots=True)
class IndexedParameter:
    """An identified parameter as its model has it: deviation from nominal, 1 σ after and before the rows, in `unit`."""

    name: str
    unit: str
    value: float
    sigma: float
    prior_sigma: float


@final
@dataclass(frozen=True, slots=True)
class HistoryEntry:
    """What a history compares of a run. series: runs with the same one are compared; title: of the series, for people.

    json: the content, as its history reads it.
    """

    history: str
    series: str
    title: str
    json: str


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class IndexedRun:
    """A run as the index holds it. Empty texts: not known; without a state it is a folder that holds no run.

    fingerprint: of its files when they were read. settled: only a resume or a change from outside can change it.
    identity: the same for copies of a folder. began_as: the name at its start. began, ended: UTC, ISO 8601. procedure:
    name. robot_type, serial: as the robot reported them. cell: path of the cell file. before_mm, after_mm: mean
    held-out errors. process: that writes it. words: what a search by words looks in, in lower case. content: its
    summary as JSON. nominal: digest of the robot from which its model starts. due_days: as its cell file states
    `calibration_days`.
    """

    run: str
    fingerprint: str
    settled: bool = False
    identity: str = ""
    began_as: str = ""
    began: str = ""
    ended: str = ""
    state: str
    verdict: str = ""
    procedure: str = ""
    robot_type: str = ""
    serial: str = ""
    site: str = ""
    cell: str = ""
    operator: str = ""
    simulated: bool = False
    points: int | None = None
    before_mm: float | None = None
    after_mm: float | None = None
    acceptance: str = ""
    table_state: str = ""
    process: str = ""
    has_model: bool = False
    nominal: str = ""
    due_days: float | None = None
    words: str = ""
    content: str
    parameters: tuple[IndexedParameter, ...] = ()
    entries: tuple[HistoryEntry, ...] = ()
