"""The index of one folder of runs in a database: writes what was read of runs, answers lists, histories and trends."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any, final

from sqlalchemy import (
    Column,
    ColumnElement,
    Connection,
    Engine,
    Row,
    Select,
    Table,
    delete,
    func,
    insert,
    select,
    text,
    update,
)
from sqlalchemy.exc import SQLAlchemyError

from cellctl.run_index._content import (
    APPLICATION_ID,
    CONTENTS,
    HISTORIES,
    METADATA,
    PARAMETERS,
    PLACES,
    RUNS,
    VERSION,
    VERSIONS,
    IndexedRun,
)
from cellctl.run_index._queries import FoundRun, RunFilter, Series, page_of

VANISHED = "vanished"
"""State of a run whose folder is gone."""

_OF_A_RUN = (PARAMETERS, HISTORIES, CONTENTS, RUNS)

_AT_A_TIME = 500
"""Number of names in one question; SQLite allows 32 766."""

_LOCK = 0x43454C4C
"""Number of the advisory lock that writers of a server take one after the other."""


class IndexUnusable(Exception):
    """The index cannot be opened, read or written. The journals are not touched by that."""


@contextmanager
def named_errors(what: str) -> Iterator[None]:
    """Turn errors of the database `what` into IndexUnusable."""
    try:
        yield
    except (SQLAlchemyError, OSError, ImportError) as error:
        cause = str(getattr(error, "orig", None) or error).strip().partition("\n")[0]
        raise IndexUnusable(f"{what}: {cause}") from error


@final
class RunIndex:
    """The index of the runs in one place, for any number of threads and processes. Every method raises IndexUnusable.

    place: `.` for the folder in which the index lies, which may be moved with it, else host and absolute folder. shown:
    the database, for messages. It is a context manager: leaving it closes the connections.
    """

    def __init__(self, engine: Engine, place: str, shown: str) -> None:
        self._engine = engine
        self._reading = engine.execution_options(isolation_level="AUTOCOMMIT")
        self.place, self.shown = place, shown

    def __enter__(self) -> RunIndex:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._engine.dispose()

    @contextmanager
    def _read(self) -> Iterator[Connection]:
        with named_errors(self.shown), self._reading.connect() as connection:
            yield connection

    @contextmanager
    def _write(self) -> Iterator[Connection]:
        """One transaction; writers of one database follow each other."""
        with named_errors(self.shown), self._engine.begin() as connection:
            if self._engine.dialect.name == "postgresql":
                connection.execute(text(f"SELECT pg_advisory_xact_lock({_LOCK})"))
            yield connection

    def prepare(self) -> None:
        """Make the tables that are missing; those of an older version anew."""
        if (found := self._version()) == VERSION:
            return
        if found > VERSION:
            raise IndexUnusable(f"{self.shown}: it was made by a newer cellctl ({found}, known here: {VERSION})")
        with self._write() as connection:
            if self._engine.dialect.name == "sqlite":
                connection.exec_driver_sql(f"PRAGMA application_id = {APPLICATION_ID}")
            METADATA.drop_all(connection)
            METADATA.create_all(connection)
            connection.execute(insert(VERSIONS).values(version=VERSION))

    def _version(self) -> int:
        with self._read() as connection:
            if not self._engine.dialect.has_table(connection, VERSIONS.name):
                return 0
            return int(connection.execute(select(func.max(VERSIONS.c.version))).scalar() or 0)

    def put(self, runs: Sequence[IndexedRun]) -> None:
        """Write what was read of these runs, in place of what was known of them."""
        rows: dict[Table, list[dict[str, Any]]] = {table: [] for table in _OF_A_RUN}
        for run in runs:
            for table, each in self._rows(run).items():
                rows[table] += each
        with self._write() as connection:
            self._delete(connection, [run.run for run in runs])
            for table, each in rows.items():
                if each:
                    connection.execute(insert(table), each)

    def vanish(self, names: Sequence[str]) -> None:
        """Mark these runs as vanished; remove those that are in the same place by another name, and what was no run."""
        if not names:
            return
        with self._write() as connection:
            for name in names:
                own = (RUNS.c.place == self.place) & (RUNS.c.run == name)
                identity = select(RUNS.c.identity).where(own).scalar_subquery()
                moved = select(RUNS.c.run).where(
                    RUNS.c.place == self.place, RUNS.c.run != name, RUNS.c.present, RUNS.c.identity == identity
                )
                nameless = select(RUNS.c.run).where(own, RUNS.c.identity == "")
                if connection.execute(nameless).first() or connection.execute(moved).first():
                    self._delete(connection, [name])
                else:
                    gone = {"present": False, "state": VANISHED, "settled": True, "process": ""}
                    connection.execute(update(RUNS).where(own).values(gone))

    def _delete(self, connection: Connection, names: Sequence[str]) -> None:
        for table in _OF_A_RUN:
            connection.execute(delete(table).where(table.c.place == self.place, table.c.run.in_(names)))

    def clear(self) -> None:
        """Remove all that is known of this place."""
        with self._write() as connection:
            for table in (*_OF_A_RUN, PLACES):
                connection.execute(delete(table).where(table.c.place == self.place))

    def remember(self, names: str, looked: str) -> None:
        """Keep the digest of the folders' names, and when every journal was compared; empty: not now."""
        with self._write() as connection:
            before = connection.execute(select(PLACES).where(PLACES.c.place == self.place)).first()
            if before and before.names == names and not looked:
                return
            connection.execute(delete(PLACES).where(PLACES.c.place == self.place))
            kept = looked or (before.looked if before else "")
            connection.execute(insert(PLACES).values(place=self.place, names=names, looked=kept))

    def folders(self) -> tuple[str, int]:
        """The digest of the folders' names that was kept last, empty without one; how many folders have a row now."""
        with self._read() as connection:
            present = select(func.count()).where(RUNS.c.place == self.place, RUNS.c.state != VANISHED)
            return self._of_place("names"), int(connection.execute(present).scalar() or 0)

    def looked(self) -> str:
        """When every journal was last compared with its row, UTC, ISO 8601; empty if never."""
        return self._of_place("looked")

    def _of_place(self, name: str) -> str:
        with self._read() as connection:
            return str(connection.execute(select(PLACES.c[name]).where(PLACES.c.place == self.place)).scalar() or "")

    def differs(self, run: IndexedRun) -> bool:
        """Whether the index holds something else of this run than its journal says."""
        with self._read() as connection:
            for table, rows in self._rows(run).items():
                columns = [column for column in table.columns if column.name not in ("fingerprint", "settled")]
                own = select(*columns).where(table.c.place == self.place, table.c.run == run.run)
                wanted = sorted(tuple(row[column.name] for column in columns) for row in rows)
                if sorted(map(tuple, connection.execute(own))) != wanted:
                    return True
        return False

    def _rows(self, run: IndexedRun) -> dict[Table, list[dict[str, Any]]]:
        """The rows of a run in each table."""
        key = {"place": self.place, "run": run.run}
        fields = {column.name: getattr(run, column.name, None) for column in RUNS.columns}
        return {
            PARAMETERS: [{**key, **asdict(each)} for each in run.parameters],
            HISTORIES: [{**key, **asdict(each), "began": run.began} for each in run.entries],
            CONTENTS: [{**key, "json": run.content}],
            RUNS: [{**fields, **key, "present": True}],
        }

    def known(self) -> dict[str, tuple[str, bool]]:
        """Run → its fingerprint, and whether its folder was there."""
        wanted = select(RUNS.c.run, RUNS.c.fingerprint, RUNS.c.present).where(RUNS.c.place == self.place)
        with self._read() as connection:
            return {run: (found, bool(present)) for run, found, present in connection.execute(wanted)}

    def unsettled(self) -> list[tuple[str, str, str]]:
        """Run, fingerprint and process of the runs that may change by themselves."""
        wanted = select(RUNS.c.run, RUNS.c.fingerprint, RUNS.c.process).where(
            RUNS.c.place == self.place, ~RUNS.c.settled
        )
        with self._read() as connection:
            return [tuple(row) for row in connection.execute(wanted)]

    def active(self) -> list[str]:
        """The runs that a process writes, as far as known, the one that began last first."""
        wanted = select(RUNS.c.run).where(*self._here(RUNS), ~RUNS.c.settled, RUNS.c.process != "")
        with self._read() as connection:
            return list(connection.execute(wanted.order_by(RUNS.c.began.desc())).scalars())

    def count(self, asked: RunFilter | None = None) -> int:
        """How many runs are as `asked`."""
        with self._read() as connection:
            wanted = select(func.count()).select_from(RUNS).where(*self._where(asked))
            return int(connection.execute(wanted).scalar() or 0)

    def counts(self, *names: str) -> list[tuple[Any, ...]]:
        """Number of runs with the same values in these columns: the values, then the number; sorted."""
        columns = [RUNS.c[name] for name in names]
        with self._read() as connection:
            wanted = select(*columns, func.count()).where(*self._here(RUNS)).group_by(*columns).order_by(*columns)
            return [tuple(row) for row in connection.execute(wanted)]

    def lines(self, asked: RunFilter, *names: str, everywhere: bool = False) -> list[Row[Any]]:
        """These columns of all runs as `asked`, newest first; `everywhere`: of all places, with the place first."""
        columns = [RUNS.c[name] for name in (("place", *names) if everywhere else names)]
        order = (RUNS.c.began.desc(), RUNS.c.run.desc())
        with self._read() as connection:
            wanted = select(*columns).where(*self._where(asked, everywhere=everywhere)).order_by(*order)
            return list(connection.execute(wanted))

    def page(
        self,
        asked: RunFilter | None = None,
        *,
        offset: int = 0,
        limit: int | None = None,
        order: str = "began",
        descending: bool = True,
        everywhere: bool = False,
    ) -> list[FoundRun]:
        """The runs as `asked` with what they hold, from number `offset` on, newest first or by another column.

        everywhere: of all folders that share the index.
        """
        wanted = page_of(
            self._where(asked, everywhere=everywhere), order, descending=descending, offset=offset, limit=limit
        )
        with self._read() as connection:
            rows = connection.execute(wanted).all()
            notes = self._notes(connection, rows)
        return [
            FoundRun(row.place, row.run, row.json, row.present, notes.get((row.place, row.run), "")) for row in rows
        ]

    def latest_of_cells(self, verdicts: Collection[str] = ()) -> list[FoundRun]:
        """Of each cell the run that began last, newest first; verdicts: the last one that finished with one of these
        and with measured errors.
        """
        asked = [*self._here(RUNS), RUNS.c.cell != ""]
        if verdicts:
            asked += [RUNS.c.verdict.in_(sorted(verdicts)), RUNS.c.after_mm.is_not(None), RUNS.c.state == "finished"]
        chosen = [*self._here(RUNS), RUNS.c.run.in_(_last_of_each("cell", asked, [RUNS.c.run]))]
        with self._read() as connection:
            rows = connection.execute(page_of(chosen, "began", descending=True)).all()
        return [FoundRun(row.place, row.run, row.json, row.present, "") for row in rows]

    def _notes(self, connection: Connection, rows: Sequence[Any]) -> dict[tuple[str, str], str]:
        """Place and run → that it vanished, was renamed or copied; of a page."""
        strange = [row for row in rows if row.identity and (not row.present or (row.began_as not in ("", row.run)))]
        if not strange:
            return {}
        same = select(RUNS.c.identity, RUNS.c.place, RUNS.c.run).where(
            RUNS.c.present, RUNS.c.identity.in_({row.identity for row in strange})
        )
        others: dict[str, list[tuple[str, str]]] = {}
        for identity, place, run in connection.execute(same):
            others.setdefault(identity, []).append((place, run))
        notes: dict[tuple[str, str], str] = {}
        for row in strange:
            found = others.get(row.identity, [])
            if not row.present:
                there = next((f"{place} {run}" for place, run in found), "")
                notes[row.place, row.run] = f"moved to {there}" if there else VANISHED
            elif (row.place, row.began_as) in found:
                notes[row.place, row.run] = f"copy of {row.began_as}"
            else:
                notes[row.place, row.run] = f"renamed, began as {row.began_as}"
        return notes

    def values(self, column: str) -> list[str]:
        """The values of a column of the list, without the empty one, sorted."""
        found = RUNS.c[column]
        wanted = select(found).where(*self._here(RUNS), found != "").distinct().order_by(found)
        with self._read() as connection:
            return list(connection.execute(wanted).scalars())

    def series(self, history: str) -> list[Series]:
        """The series of a history, the one with the latest run first."""
        of = HISTORIES.c
        wanted = (
            select(of.series, func.max(of.title), func.count(), func.max(of.began))
            .where(of.place == self.place, of.history == history)
            .group_by(of.series)
            .order_by(func.max(of.began).desc(), of.series)
        )
        with self._read() as connection:
            return [Series(*row) for row in connection.execute(wanted)]

    def runs_in(self, history: str) -> list[str]:
        """The names of all runs that a history has, also of those that it cannot compare."""
        of = HISTORIES.c
        with self._read() as connection:
            found = select(of.run).where(of.place == self.place, of.history == history).order_by(of.run)
            return list(connection.execute(found).scalars())

    def entries(self, history: str, series: str) -> list[tuple[str, str]]:
        """Run and content (JSON) of the runs of a series, oldest first."""
        of = HISTORIES.c
        own = (of.place == self.place, of.history == history, of.series == series)
        with self._read() as connection:
            wanted = select(of.run, of.json).where(*own).order_by(of.began, of.run)
            return [tuple(row) for row in connection.execute(wanted)]

    def serial_of(self, run: str) -> str:
        """The serial of the robot of this run; empty if it is not known."""
        with self._read() as connection:
            wanted = select(RUNS.c.serial).where(RUNS.c.place == self.place, RUNS.c.run == run)
            return str(connection.execute(wanted).scalar() or "")

    def with_model(self, serial: str) -> list[FoundRun]:
        """The runs of a robot that have a model, oldest first."""
        conditions = [*self._here(RUNS), RUNS.c.present, RUNS.c.has_model, RUNS.c.serial == serial]
        with self._read() as connection:
            rows = connection.execute(page_of(conditions, "began", descending=False)).all()
        return [FoundRun(row.place, row.run, row.json, row.present, "") for row in rows]

    def robots(self) -> list[Row[Any]]:
        """Of each robot of all places serial, type, site, whether simulated, number of runs, begin of the last one."""
        what = [RUNS.c[name] for name in ("serial", "robot_type", "site", "simulated")]
        conditions = (RUNS.c.serial != "", RUNS.c.state != "", RUNS.c.began != "")
        wanted = select(*what, func.count().label("runs"), func.max(RUNS.c.began).label("last"))
        with self._read() as connection:
            return list(connection.execute(wanted.where(*conditions).group_by(*what).order_by(*what)))

    def model_runs(self, serial: str = "") -> list[Row[Any]]:
        """The runs of all places that have a model (`serial`: of this robot), by robot, oldest first."""
        columns = [RUNS.c[name] for name in ("place", "run", "serial", "began", "table_state", "identity", "nominal")]
        conditions = [RUNS.c.has_model, RUNS.c.present, RUNS.c.serial != "", RUNS.c.began != ""]
        conditions += [RUNS.c.serial == serial] if serial else []
        wanted = select(*columns, RUNS.c.due_days).where(*conditions)
        with self._read() as connection:
            found: list[Any] = [*connection.execute(wanted.order_by(RUNS.c.serial, RUNS.c.began, RUNS.c.run)).all()]
            return found

    def parameters_of(
        self, place: str, runs: Sequence[str], determined: float
    ) -> list[tuple[str, str, str, float, float]]:
        """Run, name, unit, value and σ of the parameters of these runs whose σ their rows made smaller than
        `determined` times that before them.
        """
        of = PARAMETERS.c
        wanted = select(of.run, of.name, of.unit, of.value, of.sigma)
        wanted = wanted.where(of.place == place, of.sigma < determined * of.prior_sigma)
        found: list[Any] = []
        with self._read() as connection:
            for start in range(0, len(runs), _AT_A_TIME):
                found += connection.execute(wanted.where(of.run.in_(runs[start : start + _AT_A_TIME]))).all()
        return found

    def latest_judged(self, verdicts: Collection[str]) -> list[Row[Any]]:
        """Of each robot the last finished run with one of these verdicts, and the last one with an acceptance."""
        found: list[Any] = []
        finished = (RUNS.c.serial != "", RUNS.c.state == "finished")
        columns = [RUNS.c[name] for name in ("serial", "run", "began", "verdict", "acceptance")]
        with self._read() as connection:
            for kind in (RUNS.c.verdict.in_(sorted(verdicts)), RUNS.c.acceptance != ""):
                found += connection.execute(_last_of_each("serial", [*finished, kind], columns)).all()
        return found

    def _here(self, table: Table) -> list[Any]:
        conditions: list[Any] = [table.c.place == self.place]
        return [*conditions, RUNS.c.state != ""] if table is RUNS else conditions

    def _where(self, asked: RunFilter | None, *, everywhere: bool = False) -> list[Any]:
        here = [RUNS.c.state != ""] if everywhere else self._here(RUNS)
        return [*here, *(asked.conditions() if asked else ())]


def _last_of_each(key: str, conditions: Sequence[ColumnElement[bool]], columns: Sequence[Column[Any]]) -> Select[Any]:
    """These columns of the run that began last, of each value of the column `key`, among those with the conditions."""
    of = RUNS.c[key]
    last = select(of, func.max(RUNS.c.began).label("began")).where(*conditions).group_by(of).subquery()
    same = (of == last.c[key]) & (RUNS.c.began == last.c.began)
    return select(*columns).join(last, same).where(*conditions)
