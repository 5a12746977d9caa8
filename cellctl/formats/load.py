"""Loads: the cell file's `load:`, and the loads that an identification saw, between which a model interpolates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, Self, final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cellctl.calibration import Postures
from cellctl.files import Document
from cellctl.files.validated import validated
from cellctl.kinematics import Floats
from cellctl.robot_file import Triple

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


SAME_KG = 0.01
SAME_PLACE_MM = 5.0
"""Centres of gravity nearer to each other than this are one: nobody knows a load's better."""

_Mass = Annotated[float, Field(allow_inf_nan=False, ge=0.0)]


@final
class LoadRegion(BaseModel):
    """Least and greatest payload among the rows of a fit, kg, and its centre of gravity, flange frame, mm.

    at: None where the rows do not state it (at the TCP), or where no row has a payload.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    min: _Mass
    max: _Mass
    at: Triple | None = None

    @classmethod
    def of(cls, rows: Iterable[Postures]) -> Self | None:
        """The region of these rows; None where none states its payload."""
        stated = [(each.payload, each.payload_at) for each in rows if each.payload is not None and len(each)]
        if not stated:
            return None
        masses = np.concatenate([payload for payload, _ in stated])
        places = [at[payload > 0.0] for payload, at in stated if at is not None]
        loaded = np.concatenate(places) if places else np.zeros((0, 3))
        at = loaded.mean(axis=0).tolist() if len(loaded) else None
        return cls(min=float(masses.min()), max=float(masses.max()), at=at)

    def joined(self, other: LoadRegion | None) -> LoadRegion:
        """This region and another one's masses, where the centre of gravity is the same; else this one."""
        if other is None or not (self._of_none or other._of_none or _same(self.at, other.at)):
            return self
        at = self.at if other._of_none else other.at
        return LoadRegion(min=min(self.min, other.min), max=max(self.max, other.max), at=at)

    def refused(self, at: Postures) -> Iterator[tuple[int, str, str]]:
        """Rows (from 0) whose payload is not within the region: row, reason, cure."""
        if at.payload is None:
            return
        span = f"{self.min:g} … {self.max:g} kg" if self.min < self.max else f"{self.max:g} kg"
        for row, mass in enumerate(at.payload.tolist()):
            place = None if at.payload_at is None else at.payload_at[row]
            if not self.min - SAME_KG <= mass <= self.max + SAME_KG:
                reason = f"payload is {mass:g} kg, and the model was identified with {span}"
                yield row, reason, f"identify from rows with a payload on either side of {mass:g} kg"
            elif mass > SAME_KG and not _same(self.at, place):
                reason = f"the payload's centre of gravity is {_words(place)}, and in the fit it was {_words(self.at)}"
                yield row, reason, "identify from rows with the payload at this place, or correct payload_x, _y, _z"

    @property
    def _of_none(self) -> bool:
        """Whether no row had any payload."""
        return self.max == 0.0


def two_centres(at: Postures) -> tuple[int, int] | None:
    """Two rows (from 0) with a payload whose centres of gravity differ; None where there are none."""
    if at.payload is None or at.payload_at is None:
        return None
    loaded = np.flatnonzero(at.payload > 0.0)
    if not len(loaded):
        return None
    apart = np.linalg.norm(at.payload_at[loaded] - at.payload_at[loaded[0]], axis=1)
    far = int(apart.argmax())
    return (int(loaded[0]), int(loaded[far])) if apart[far] > SAME_PLACE_MM else None


def _same(one: Triple | Floats | None, other: Triple | Floats | None) -> bool:
    if one is None or other is None:
        return one is None and other is None
    return bool(np.linalg.norm(np.subtract(one, other)) <= SAME_PLACE_MM)


def _words(at: Triple | Floats | None) -> str:
    return "at the TCP" if at is None else "at ({:g}, {:g}, {:g}) mm of the flange".format(*at)
