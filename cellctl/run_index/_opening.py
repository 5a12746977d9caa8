"""Opens the index of a folder of runs: a server's, the file beside the runs, or else one that lasts as long as it is
open. A run or a list never fails for its index: a warning says what is used instead.
"""

from __future__ import annotations

import logging
import os
import shutil
import socket
import sqlite3
import tempfile
import weakref
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, Final

from sqlalchemy import URL, Engine, create_engine, event
from sqlalchemy.engine import make_url

from cellctl.files import InputError, Problem
from cellctl.run_index._content import APPLICATION_ID
from cellctl.run_index._store import IndexUnusable, RunIndex, named_errors

FILE_NAME: Final = "index.sqlite"
"""In the folder of the runs."""

VARIABLE: Final = "CELLCTL_INDEX"
"""Environment variable with the URL of another index, for this process and those that it starts."""

_BUSY_S: Final = 10.0
"""Longest wait for another writer, whose transactions take some milliseconds."""

_HEAD: Final = 72
"""Number of bytes of an SQLite file up to the end of its application id."""

_DRIVERS: Final = {"postgresql": "postgresql+psycopg", "postgres": "postgresql+psycopg"}


def shared_url() -> str:
    """The URL of the index that several folders share; empty: each folder has its own."""
    return os.environ.get(VARIABLE, "")


def opened_index(runs: Path, *, strict: bool = False, temporary: bool = False) -> RunIndex:
    """The index of the folder `runs`: that of the environment's URL, else the folder's own.

    strict: raise IndexUnusable if that one cannot be used. Otherwise the folder's own, or one that lasts as long as it
    is open (the only one if `temporary`), is used instead, and a warning says so. Raises InputError for a URL that is
    none.
    """
    url = shared_url()
    attempts: list[Callable[[Path], RunIndex]] = []
    if not temporary:
        attempts += [_shared] if url else []
        attempts += [_own] if not (strict and url) else []
    attempts += [_temporary] if not strict else []
    for attempt in attempts:
        try:
            return attempt(runs)
        except IndexUnusable as error:
            if strict:
                raise
            logging.getLogger(__name__).warning("the index of the runs cannot be used: %s", error)
    raise IndexUnusable("no index can be made: there is no space for a temporary one")


def _shared(runs: Path) -> RunIndex:
    url = shared_url()
    try:
        address = make_url(url)
    except Exception as error:
        raise _no_url(url, str(error)) from error
    address = address.set(drivername=_DRIVERS.get(address.drivername, address.drivername))
    shown = address.render_as_string(hide_password=True)
    if address.get_backend_name() not in ("sqlite", "postgresql"):
        raise _no_url(shown, "is of no database that can hold an index")
    place = f"{socket.gethostname()}:{runs.resolve()}"
    server = address.get_backend_name() == "postgresql"
    with named_errors(shown):
        engine = create_engine(address, pool_pre_ping=True) if server else _sqlite(address.database or "")
    return _prepared(RunIndex(engine, place, shown))


def _no_url(url: str, what: str) -> InputError:
    cure = "give one such as postgresql://user@host/database or sqlite:////folder/index.sqlite"
    return InputError(Problem(f"--index {url}", 0, 0, what, cure))


def _own(runs: Path) -> RunIndex:
    """That beside the runs. A damaged one is made anew: all of it is in the journals."""
    if not runs.is_dir():
        return _temporary(runs)
    file = runs / FILE_NAME
    remove_damaged(runs)
    with named_errors(str(file)), suppress(FileNotFoundError), file.open("rb") as found:
        head = found.read(_HEAD)
        if head and int.from_bytes(head[_HEAD - 4 :]) not in (0, APPLICATION_ID):
            raise IndexUnusable(f"{file}: it is a database of another program")
    try:
        return _prepared(RunIndex(_sqlite(str(file)), ".", str(file)))
    except IndexUnusable:
        if not remove_damaged(runs, thorough=True):
            raise
        return _prepared(RunIndex(_sqlite(str(file)), ".", str(file)))


def remove_damaged(runs: Path, *, thorough: bool = False) -> bool:
    """Remove the folder's own index if it is no database or, looking at all of it if `thorough`, a damaged one.

    Returns whether it did. Raises IndexUnusable if it cannot be removed.
    """
    file = runs / FILE_NAME
    try:
        with closing(sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True, timeout=_BUSY_S)) as connection:
            found = connection.execute("PRAGMA quick_check(1)" if thorough else "PRAGMA schema_version").fetchone()
            damaged = thorough and found != ("ok",)
    except sqlite3.DatabaseError as error:
        damaged = getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT)
    if damaged:
        logging.getLogger(__name__).warning("%s is damaged, and is made anew from the journals", file)
        with named_errors(str(file)):
            for name in (FILE_NAME, f"{FILE_NAME}-wal", f"{FILE_NAME}-shm"):
                (runs / name).unlink(missing_ok=True)
    return damaged


def _temporary(runs: Path) -> RunIndex:
    """In a file of its own, which is removed when it is closed; it begins as a copy of the folder's own."""
    with named_errors("a temporary index"):
        folder = tempfile.TemporaryDirectory(prefix="cellctl-index-")
    copy = Path(folder.name)
    for name in (FILE_NAME, f"{FILE_NAME}-wal"):
        with suppress(OSError):
            shutil.copy(runs / name, copy / name)
    try:
        index = _own(copy)
    except IndexUnusable:  # of a newer version, or of another program
        for file in copy.iterdir():
            file.unlink()
        index = _own(copy)
    index.shown = "a temporary index"
    weakref.finalize(index, folder.cleanup)
    return index


def _sqlite(file: str) -> Engine:
    engine = create_engine(URL.create("sqlite", database=file))

    @event.listens_for(engine, "connect")
    def _(connection: Any, _: object) -> None:
        connection.execute(f"PRAGMA busy_timeout = {int(_BUSY_S * 1000)}")
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = NORMAL")  # a power cut may take the last runs: a scan finds them

    @event.listens_for(engine, "begin")
    def _(connection: Any) -> None:
        if "isolation_level" not in connection.get_execution_options():  # it writes: see RunIndex
            connection.exec_driver_sql("BEGIN IMMEDIATE")

    return engine


def _prepared(index: RunIndex) -> RunIndex:
    try:
        index.prepare()
    except IndexUnusable:
        index.close()
        raise
    return index
