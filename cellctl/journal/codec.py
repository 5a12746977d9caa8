"""Conversion between events and rows of the journal."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from typing import Any, get_args

from pydantic import TypeAdapter, ValidationError

from cellctl.files import canonical_json
from cellctl.files.plain_words import plain_words
from cellctl.journal.events import Event, KnownEvent, RawEvent

Columns = tuple[str, str, int, str]
"""kind, step, attempt, data: the event's other fields as canonical JSON."""


def encode(event: KnownEvent) -> Columns:
    """The row of `event`. Raises ValueError, naming event and step, for NaN and other values that JSON cannot hold."""
    fields = asdict(event)
    step, attempt = fields.pop("step", ""), fields.pop("attempt", 0)
    try:
        data = canonical_json(fields)
        data.encode()
    except (ValueError, TypeError) as error:
        where = f" of step '{step}'" if step else ""
        raise ValueError(f"event '{event.kind}'{where} cannot be recorded: {error}") from error
    return event.kind, step, attempt, data


def decode(columns: Columns) -> Event:
    """The event in a row. An unknown kind gives a RawEvent; unknown fields are ignored.

    Raises ValueError if the row does not match its kind.
    """
    kind, step, attempt, text = columns
    try:
        data: dict[str, Any] = json.loads(text)
    except ValueError as error:
        raise ValueError(f"{kind}: its data is no JSON") from error
    reader = _readers().get(kind)
    if reader is None:
        return RawEvent(kind, data, step, attempt)
    try:
        event: Event = reader.validate_python({**data, "step": step, "attempt": attempt})
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        raise ValueError(f"{kind}: {'.'.join(map(str, detail['loc']))} {plain_words(detail)}") from error
    return event


@cache
def _readers() -> dict[str, TypeAdapter[Any]]:
    return {event.kind: TypeAdapter(event) for event in get_args(KnownEvent)}
