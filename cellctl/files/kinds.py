"""Which kind of file a text is, so that a file of another kind is refused in one sentence, not by its first errors."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from cellctl.files.problems import InputError, Problem

ROBOT, CELL, PROCEDURE, ARTEFACT = "robot file", "cell file", "procedure", "artefact file"
MODEL, TABLE, CORRECTION, DATA_SET, JOURNAL = (
    "model file",
    "table file",
    "correction file",
    "data set (CSV)",
    "journal of a run",
)
PRIOR = "prior file"
EXPORT = "file that a pendant saved"
OWN = (ROBOT, CELL, PROCEDURE, ARTEFACT, MODEL, TABLE, CORRECTION, PRIOR)
"""Kinds that only cellctl has: no pendant saves them."""

_BY_KEYS = (
    (PROCEDURE, {"steps"}),
    (PROCEDURE, {"procedure"}),
    (CELL, {"model", "devices"}),
    (ROBOT, {"convention"}),
    (ROBOT, {"links", "joints"}),
    (ARTEFACT, {"spheres"}),
    (ARTEFACT, {"sockets"}),
    (TABLE, {"rows", "robot", "tool"}),
)
"""Keys at the top of a file → what it is; the first that fits."""

_CURES = {
    ROBOT: "give a robot file, or a name of `cellctl robots`",
    MODEL: "give a file that `cellctl fit --out` wrote",
    PRIOR: "give a file that `cellctl prior` wrote",
    TABLE: "give a file that `cellctl compensate` or a campaign wrote",
    DATA_SET: "give a CSV with a header row",
    JOURNAL: "name a run folder with a journal.sqlite written by cellctl",
}
_KEY = re.compile(r"^([A-Za-z_]\w*) *:", re.MULTILINE)
_COLUMN = re.compile(r"[AqI]\d{1,2}|[XYZ]|sphere|socket|radius")
_KRL = re.compile(r"\s*(?:&ACCESS|(?:GLOBAL\s+)?DEF(?:DAT|FCT)?\s)", re.IGNORECASE)
_HEAD = 1_000_000
"""Bytes of a file that are looked at."""


def kind_of(text: str) -> str:
    """What a file with this text is; empty if that is not certain."""
    if text.lstrip("\ufeff \t\r\n").startswith("{"):
        return _of_json(text)
    if _KRL.match(text):
        return "KRL program"
    first = re.split(r"[,;\t]", text.lstrip("\ufeff").partition("\n")[0])
    if sum(bool(_COLUMN.fullmatch(name.strip(' "\r'))) for name in first) >= 2:
        return DATA_SET
    return _by_keys(set(_KEY.findall(text)))


def refuse_other_kind(path: Path | str, wanted: str, found: str | None = None) -> None:
    """Raise InputError if the file at `path` is certainly of another kind than `wanted`. found: its kind, None: it is
    looked at here; one that cannot be read is not refused.
    """
    found = kind_of_file(Path(path)) if found is None else found
    if found and found != wanted:
        cure = _CURES.get(wanted, f"give {_a(wanted)}")
        if (found, wanted) == (_RUN, MODEL):
            cure = f"give {path}/model.json"
        raise InputError(Problem(str(path), 0, 0, other_kind(found, wanted), cure))


def read_bytes(path: Path, wanted: str = "") -> bytes:
    """The file's bytes. Raises InputError if it cannot be read. wanted: as in `refuse_other_kind`; empty: any."""
    try:
        return path.read_bytes()
    except OSError as error:
        if wanted:  # of a folder its kind says more than the system's "is a directory"
            refuse_other_kind(path, wanted)
        raise InputError(Problem(str(path), 0, 0, f"cannot be read: {error.strerror}", "check the path")) from error


_RUN = "folder of a run"


def other_kind(found: str, wanted: str) -> str:
    """The sentence about a file of the kind `found`."""
    return f"this is {_a(found)}, and {_a(wanted)} is needed here"


def _a(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


def kind_of_file(path: Path) -> str:
    """What the file or folder at `path` is; empty if that is not certain."""
    try:
        if path.is_dir():
            return _RUN if (path / "journal.sqlite").exists() else "folder"
        if not path.is_file():  # a pipe is read once, by its reader
            return ""
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return ""
    return JOURNAL if head.startswith(b"SQLite format 3\0") else kind_of(head.decode("utf-8", errors="replace"))


def _of_json(text: str) -> str:
    try:
        return kind_of_content(json.loads(text))
    except (ValueError, RecursionError):
        return ""


def kind_of_content(content: Any) -> str:
    """What the file with this content (of YAML or JSON) is; empty if that is not certain."""
    if not isinstance(content, dict):
        return ""
    stated = str(content.get("format", ""))
    for kind, word in ((MODEL, "cellctl model"), (CORRECTION, "cellctl correction"), (PRIOR, "cellctl prior")):
        if stated.startswith(word):
            return kind
    return _by_keys(set(content))


def _by_keys(keys: set[str]) -> str:
    return next((kind for kind, needed in _BY_KEYS if needed <= keys), "")
