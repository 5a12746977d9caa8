"""The delays and habits of a real cell, from the record of its commissioning: values of the simulators' settings."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sims.section import Section
from sims.settings import Setting
from sims.simulators import Simulators

FORMAT = "cellctl commissioning 1"


def measured_settings(
    section: Section, folder: Path, cell: str, addresses: Mapping[str, str], simulators: Simulators
) -> dict[str, dict[str, Any]]:
    """Section → setting → value, of `simulate: {commissioning: FILE}`; empty without it. Errors are noted.

    The record is that of the cell of this name, the real one where there are two.
    """
    if "commissioning" not in section.entries:
        return {}
    file = section.word("commissioning")
    try:
        figures = dict(_figures(json.loads((folder / file).read_text(encoding="utf-8")), cell))
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        section.note("commissioning", f"{file} is no record of a commissioning that can be read: {error}")
        return {}
    if not figures:
        section.note("commissioning", f"{file} has no record of the cell '{cell}'")
    found: dict[str, dict[str, Any]] = {}
    for device, address in addresses.items():
        one = simulators.of(address)
        for setting in one.settings if one else ():
            if setting.measured and (value := figures.get(f"{device}.{setting.measured}")) is not None:
                assert one
                found.setdefault(one.section, {})[setting.name] = _as(setting, value)
    return found


def _figures(content: dict[str, Any], cell: str) -> Iterator[tuple[str, float | str | None]]:
    """`DEVICE.STEP.FIGURE` and value of each; those of a failed step too: the cell is as it is."""
    if content["format"] != FORMAT:
        raise ValueError(f"its format is '{content['format']}', and '{FORMAT}' is known here")
    records = sorted((one for one in content["cells"] if one["cell"] == cell), key=lambda one: bool(one["simulated"]))
    for step in records[0]["steps"] if records else ():
        for figure in step["figures"]:
            yield f"{step['id']}.{figure['name']}", figure["value"]


def _as(setting: Setting, value: float | str) -> float | str:
    """The value as the setting takes it: whole, and a multiple of its step."""
    if setting.kind != "whole" or isinstance(value, str):
        return value
    step = setting.step or 1
    return step * round(value / step)
