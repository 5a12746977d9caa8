"""Canonical JSON: equal values have equal text and an equal hash."""

from __future__ import annotations

import hashlib
import json
from typing import Any


def canonical_json(value: Any) -> str:
    """JSON of `value` with sorted keys, no spaces and shortest round-trip numbers; NaN and infinities are refused.

    Raises ValueError for a number that JSON cannot hold, TypeError for a type that it cannot.
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def sha256_of(value: Any) -> str:
    """SHA-256 (hex) of `value`: of a string's or bytes' own content, of anything else's canonical JSON."""
    if not isinstance(value, bytes):
        value = (value if isinstance(value, str) else canonical_json(value)).encode()
    return hashlib.sha256(value).hexdigest()
