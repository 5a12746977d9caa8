"""The cell file's `load:`: what the robot carries besides its tool, as its controller was told."""

from __future__ import annotations

from typing import Annotated, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.files import Document
from cellctl.files.validated import validated
from cellctl.formats.robot import Triple

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)


@final
class Load(BaseModel):
    """The load of the robot. Campaigns record it.

    name: as the controller's load data are called. mass: kg, without the tool. xyz: centre of gravity in the flange
    frame, mm. absolute_accuracy: whether the controller's own option for absolute accuracy is on: it corrects targets
    too, so that a table of ours on top of it would compensate twice.
    """

    model_config = _STRICT
    name: str = ""
    mass: Annotated[float, Field(allow_inf_nan=False, ge=0, le=10_000)]
    xyz: Triple
    absolute_accuracy: bool = False


def load_of(document: Document) -> Load | None:
    """The `load:` of a loaded cell file, if it has one. Raises InputError with every error."""
    return validated(document, Load, ("load",)) if "load" in document.data else None
