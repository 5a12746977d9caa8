"""The cell file's `report:`: what a calibration report states and no device reports."""

from __future__ import annotations

import datetime
from collections.abc import Collection
from typing import Annotated, final

from pydantic import BaseModel, ConfigDict, Field, field_validator

from cellctl.files import Document, Problem

ARTEFACT = "artefact"
"""The name of the artefact among devices, and in the uncertainties."""

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)
_Sigma = Annotated[float, Field(allow_inf_nan=False, ge=0, le=100)]


@final
class Calibrated(BaseModel):
    """The last calibration of an instrument or of the artefact: date (ISO 8601), certificate.

    serial: of the artefact, or of an instrument that does not report the right one.
    """

    model_config = _STRICT
    date: str
    certificate: str = ""
    serial: str = ""

    @field_validator("date")
    @classmethod
    def _is_date(cls, value: str) -> str:
        try:
            return datetime.date.fromisoformat(value).isoformat()
        except ValueError:
            raise ValueError(f"'{value}' is no date; write it as 2026-03-01") from None


@final
class ReportFacts(BaseModel):
    """Customer, site, order and operator; "" where they are not stated. limit_mm: the acceptance limit of an error.

    calibrated: device name, or `artefact` → its last calibration. sigma_mm: source → standard uncertainty (type B) of a
    measured error, mm: along the normal for touches, 3-D for points; `artefact` and `temperature` among the sources.
    """

    model_config = _STRICT
    customer: str = ""
    site: str = ""
    order: str = ""
    operator: str = ""
    limit_mm: Annotated[float, Field(allow_inf_nan=False, gt=0)] | None = None
    calibrated: dict[str, Calibrated] = {}
    sigma_mm: dict[str, _Sigma] = {}


def unknown_instruments(document: Document, facts: ReportFacts, devices: Collection[str]) -> list[Problem]:
    """A problem for each name under `calibrated` that is no device and not the artefact."""
    known = [*devices, ARTEFACT]
    return [
        document.problem(
            ("report", "calibrated", name), f"there is no device '{name}'", f"known are {', '.join(known)}", key=True
        )
        for name in facts.calibrated
        if name not in known
    ]
