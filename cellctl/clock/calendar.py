"""Date and time of day: a label for people, never used to measure."""

from __future__ import annotations

import datetime


def calendar_time() -> str:
    """The calendar time in UTC, ISO 8601 to the second, as `2026-11-21T19:24:33Z`."""
    now = datetime.datetime.now(datetime.UTC)  # noqa: TID251 - the one place that may
    return now.strftime("%Y-%m-%dT%H:%M:%SZ")
