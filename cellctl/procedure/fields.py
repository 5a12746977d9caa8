"""Reads one mapping of a document key by key, collects errors with suggestions, and continues after each."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, final

from cellctl.files import Document, Path, Problem


def did_you_mean(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """A cure for an unknown `word`: the nearest known one, or else the short list of them, or `otherwise`."""
    names = sorted(known)
    near = difflib.get_close_matches(word, names, n=1)
    if near:
        return f"did you mean '{near[0]}'?"
    if otherwise or not names:
        return otherwise
    return f"known here: {', '.join(names)}"


T = TypeVar("T")

NAME_RULE = "a name is small letters, digits and underscores, a letter first"
"""The cure for a wrong name."""

_NAME = re.compile(r"[a-z][a-z0-9_]*")


@final
class Findings:
    """The errors found in one document so far."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.problems: list[Problem] = []

    def report(self, at: Path, what: str, cure: str = "", *, key: bool = False) -> None:
        """Note an error at the value (or key) at `at`."""
        self.problems.append(self.document.problem(at, what, cure, key=key))


@final
class Fields:
    """The mapping at `at`; keys other than `known` are reported at once."""

    def __init__(self, findings: Findings, value: Any, at: Path, known: tuple[str, ...], what: str) -> None:
        self._findings = findings
        self._is_mapping = isinstance(value, dict)
        self._value: dict[str, Any] = value if isinstance(value, dict) else {}
        self.at = at
        self._what = what
        if not self._is_mapping:
            findings.report(at, f"{what} has to be a mapping", f"write its keys here: {', '.join(known)}")
        for key in [key for key in self._value if key not in known]:
            cure = did_you_mean(key, known, f"remove it; known here: {', '.join(known)}")
            findings.report((*at, key), f"'{key}' is not known in {what}", cure, key=True)

    def __contains__(self, key: str) -> bool:
        return key in self._value

    def report(self, key: str, what: str, cure: str = "") -> None:
        """Note an error at the value of `key`."""
        self._findings.report((*self.at, key), what, cure)

    def raw(self, key: str, *, needed: bool = False) -> Any:
        """The unchanged value; None if it is missing, which is reported if it is `needed`."""
        if needed and self._is_mapping and key not in self._value:
            self._findings.report(self.at, f"'{key}' is missing in {self._what}", f"add '{key}:'")
        return self._value.get(key)

    def text(self, key: str, *, needed: bool = False) -> str:
        """Text; empty if it is missing or wrong."""
        return self._read(key, needed, "", lambda v: isinstance(v, str), "write text here, in quotes if need be")

    def name(self, key: str, *, needed: bool = True) -> str:
        """A name: small letters, digits, underscores. Empty if it is missing or wrong."""
        return self._read(key, needed, "", is_name, NAME_RULE)

    def number(self, key: str, *, above: float = -math.inf) -> float | None:
        """A finite number greater than `above`; None where it is missing or wrong."""
        cure = "write a number" if above == -math.inf else f"write a number above {above:g}"
        value = self._read(key, False, None, lambda v: is_number(v) and v > above, cure)
        return None if value is None else float(value)

    def integer(self, key: str, default: int, least: int) -> int:
        """A whole number, `least` or more; `default` where it is missing or wrong."""
        cure = f"write a whole number, {least} or more"
        return self._read(key, False, default, lambda v: is_number(v) and isinstance(v, int) and v >= least, cure)

    def one_of(self, key: str, words: tuple[str, ...], default: str, *, needed: bool = False) -> str:
        """One of `words`; `default` where it is missing or wrong."""
        cure = f"write one of: {', '.join(words)}"
        return self._read(key, needed, default, lambda v: isinstance(v, str) and v in words, cure)

    def words(self, key: str) -> tuple[str, ...]:
        """A list of words; empty where it is missing or wrong."""
        words: list[str] = self._read(key, False, [], _are_words, "write a list of words: [one, two]")
        return tuple(words)

    def _read(self, key: str, needed: bool, default: T, good: Callable[[Any], bool], cure: str) -> T:
        value = self.raw(key, needed=needed)
        if key not in self._value:
            return default
        if good(value):
            return value  # type: ignore[no-any-return]
        shown = "" if isinstance(value, dict | list) else f" (here: {'nothing' if value is None else repr(value)})"
        self.report(key, f"'{key}' of {self._what} is not usable{shown}", cure)
        return default


def is_number(value: Any) -> bool:
    """Whether `value` is a finite number, not a flag; an integer must fit in 64 bits."""
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) < 2**63
    return isinstance(value, float) and math.isfinite(value)


def is_name(value: Any) -> bool:
    """Whether `value` is a name: small letters, digits and underscores, a letter first."""
    return isinstance(value, str) and _NAME.fullmatch(value) is not None


def _are_words(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(word, str) for word in value)
