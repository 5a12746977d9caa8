"""The JSON Schema of a cell file's `simulate:` section, from the descriptions of the simulators that are installed."""

from __future__ import annotations

from itertools import combinations
from typing import Any

from sims.cell_content import ERRORS
from sims.faults import WHEN
from sims.settings import FaultKind
from sims.simulators import Simulators

_COUNT = {"type": "integer", "minimum": 1}
_TRIPLE = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
_MS = {"type": "number", "minimum": 0}


def schema_of(simulators: Simulators) -> dict[str, Any]:
    """As `python -m sims schema` prints it."""
    sections = {one.section: one for one in simulators.all if one.section}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "The simulate: section of a cell file",
        **_mapping(
            {
                "seed": {"type": "integer", "minimum": 0, "default": 1},
                "clock": {"enum": ["lockstep", "realtime"], "default": "lockstep"},
                "errors": {
                    "description": "Each can be switched off (false) or scaled (a number; 1: as on a real robot).",
                    **_mapping({kind: _scale(default) for kind, default in ERRORS.items()}),
                },
                "payload": {
                    "description": "What the robot truly carries besides its tool; default: the cell file's load.",
                    **_mapping({"mass": {"type": "number", "minimum": 0}, "xyz": _TRIPLE}),
                    "required": ["mass", "xyz"],
                },
                "commissioning": {
                    "description": "Record of the real cell's commissioning, which gives settings that are not here.",
                    "type": "string",
                },
                **{
                    key: _mapping({setting.name: setting.schema() for setting in one.settings})
                    for key, one in sections.items()
                },
                "faults": {"type": "array", "items": {"$ref": "#/$defs/fault"}},
            }
        ),
        "$defs": {
            "fault": _fault(simulators.faults, [event for one in simulators.all for event in one.events]),
        },
    }


def _mapping(properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _scale(default: float) -> dict[str, Any]:
    return {"type": ["boolean", "number"], "minimum": 0, "default": default}


def _fault(kinds: tuple[FaultKind, ...], events: list[str]) -> dict[str, Any]:
    """At most one key says when; a setting is for the faults alone that have it."""
    own: dict[str, dict[str, Any]] = {}
    for setting in (setting for kind in kinds for setting in kind.settings):
        own[setting.name] = _common(own.get(setting.name), setting.schema())
    without = {name: [kind.name for kind in kinds if name not in _names(kind)] for name in own}
    properties = {
        "fault": {"enum": [kind.name for kind in kinds]},
        "event": {"description": "Announced by a device of the cell.", "enum": events},
        "count": {"description": "Which of these events, from 1.", **_COUNT, "default": 1},
        "search": {"description": "Counted from 1, from its RSI_ON: as event robot.search.", **_COUNT},
        "after_ms": {"description": "After the event.", **_MS, "default": 0},
        "before_search": {"description": "From the end of the search before.", **_COUNT},
        "at_ms": {"description": "Of the cell's time.", **_MS},
        **own,
    }
    return {
        **_mapping(properties),
        "required": ["fault"],
        "allOf": [
            *({"not": {"required": list(pair)}} for pair in combinations(WHEN, 2)),
            *(
                {"if": {"properties": {"fault": {"enum": names}}}, "then": {"properties": {name: False}}}
                for name, names in without.items()
            ),
            {
                "if": {"required": ["after_ms"]},
                "then": {"anyOf": [{"required": ["event"]}, {"required": ["search"]}]},
            },
        ],
        "dependentRequired": {"count": ["event"]},
    }


def _common(one: dict[str, Any] | None, other: dict[str, Any]) -> dict[str, Any]:
    """What holds for a setting that several faults have."""
    return other if one is None else {key: value for key, value in other.items() if one.get(key) == value}


def _names(kind: FaultKind) -> set[str]:
    return {setting.name for setting in kind.settings}
