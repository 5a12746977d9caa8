"""A model in the form of another program or controller, as `cellctl convert` writes it."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from cellctl.facade.arrays import refused
from cellctl.files import write_atomically
from cellctl.formats import ModelFile

if TYPE_CHECKING:
    from cellctl.operations.exporting import ExportOptions

Form: TypeAlias = Literal["mdh-hayati", "dh-craig", "poe", "urdf", "dh-csv", "ur-calibration", "kuka", "abb", "fanuc"]
_TABLES = ("mdh-hayati", "dh-craig")
_CONVENTIONS = (*_TABLES, "poe")


def export(model: ModelFile, name: str, form: Form, path: str | Path | None, options: ExportOptions) -> str | bytes:
    """The content of the file, written to `path` if given. Warns of what the form cannot hold, with the distance that
    this costs. name: of the model in errors. Raises InputError where the model has no such form; OSError.
    """
    from cellctl.operations.exporting import exported, model_source

    made = exported(model_source(model, name), form, options)
    for line in made.lines():
        warnings.warn(line, stacklevel=4)
    if path is not None:
        write_atomically(Path(path), made.content)
    return made.content


def refuse_convention(convention: str, *, table: bool) -> None:
    """Raise InputError if `convention` is none of a robot file (table: of a DH table)."""
    known = _TABLES if table else _CONVENTIONS
    if convention not in known:
        raise refused("convention", f"'{convention}' is not known", f"one of: {', '.join(known)}")
