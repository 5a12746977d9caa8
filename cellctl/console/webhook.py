"""Sends events to an address that a person named: a chat, a pager, a plant's alarm server."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from typing import final
from urllib.parse import urlsplit

import httpx

from cellctl.clock import calendar_time
from cellctl.console.live.events import Event, Kind
from cellctl.files import InputError, Problem

SENT: frozenset[Kind] = frozenset(
    ("run_waits", "run_ended", "alarm_raised", "alarm_acknowledged", "alarm_cleared", "job_offered")
)
"""What a person who is elsewhere wants to know."""

_QUEUE = 100
_TIMEOUT_S = 10.0
RETRIES_S = (2.0, 10.0, 60.0)
"""Wall times after which what was not received is sent again; then it is dropped."""


def checked_url(url: str) -> str:
    """`url`, if a webhook can have it. Raises InputError, whose text does not contain it: it may hold a secret."""
    try:
        parts = urlsplit(url)
        valid = parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port is None or parts.port > 0)
    except ValueError:
        valid = False
    if not valid:
        raise InputError(Problem("--webhook", 0, 0, "is no address", "give one as https://chat.example/hooks/KEY"))
    return url


@final
class Webhook:
    """Posts each event of `SENT` as JSON, one after another, in a task of its own. A dead receiver slows nothing: what
    waits is bounded, and the oldest is dropped.
    """

    def __init__(self, url: str, host: str, retries_s: Sequence[float] = RETRIES_S) -> None:
        self._url, self._host, self._retries_s = url, host, retries_s
        self._waiting: asyncio.Queue[Event] = asyncio.Queue(_QUEUE)
        self.dropped = 0

    def put(self, event: Event) -> None:
        """Send `event` as soon as the ones before it are sent."""
        if event.kind not in SENT or (event.kind == "run_waits" and not event.data["for"]):
            return
        if self._waiting.full():
            self._waiting.get_nowait()
            self.dropped += 1
        self._waiting.put_nowait(event)

    async def run(self) -> None:
        """Send, until it is cancelled."""
        async with httpx.AsyncClient(timeout=_TIMEOUT_S, trust_env=True) as client:
            while True:
                event = await self._waiting.get()
                content = {"id": event.id, "event": event.kind, "time": calendar_time(), "host": self._host}
                await self._send(client, {**content, **event.data})

    async def _send(self, client: httpx.AsyncClient, content: dict[str, object]) -> None:
        for pause_s in (*self._retries_s, None):
            try:
                answer = await client.post(self._url, json=content)
                if answer.is_success:
                    return
                why = f"it answered {answer.status_code}"
            except (httpx.HTTPError, httpx.InvalidURL) as error:  # their texts may contain the address
                why = type(error).__name__
            if pause_s is not None:
                await asyncio.sleep(pause_s)
        self.dropped += 1
        logging.getLogger(__name__).warning("the webhook did not receive %s: %s", content["event"], why)
