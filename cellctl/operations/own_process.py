"""Verbs of the command line in a process of their own: what computes for seconds, or connects to devices."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Sequence
from typing import Any


async def json_of_verb(verb: str, words: Sequence[str]) -> tuple[dict[str, Any] | None, str]:
    """The JSON that `cellctl VERB WORDS` prints (None: it prints none), and its messages on stderr.

    words: `--json=-` among them. If this call is cancelled, the process is ended.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", "cellctl", verb, *words),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        out, errors = await process.communicate()
    except asyncio.CancelledError:
        process.terminate()
        await process.wait()
        raise
    said = errors.decode(errors="replace").strip().removeprefix("cellctl: ")
    try:
        return json.loads(out), said
    except ValueError:
        return None, said
