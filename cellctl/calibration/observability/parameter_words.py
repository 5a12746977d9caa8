"""Parameters in words: `θ5`, `tool translation along X, Y`, `compliance of joint 2`, `centres of S1, S2`."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cellctl.calibration.model.parameter import Parameter, Phrase

_WITH = " with "
_NUMBER = re.compile(r"\d+")
_FIRST = ("tool", "base")
_LAST = ("points", "datums")


def in_words(parameters: Sequence[Parameter]) -> list[str]:
    """The parameters as phrases, similar ones joined: links, tool, base, effects, points, zeros of lengths."""
    items: dict[tuple[int, str, int, Phrase], list[str]] = {}
    for each in parameters:
        owner = each.session if each.group in _FIRST else ""
        items.setdefault((_rank(each), owner, each.phrase.part, each.phrase), []).append(each.item)
    places = list(dict.fromkeys((rank, owner) for rank, owner, _, _ in items))
    ordered = sorted(items, key=lambda key: (key[0], places.index(key[:2]), key[2]))
    return [key[-1].of_items(items[key]) for key in ordered]


def _rank(parameter: Parameter) -> int:
    if parameter.of_the_arm:
        return 0
    if parameter.group in _FIRST:
        return 1 + _FIRST.index(parameter.group)
    return 4 + _LAST.index(parameter.group) if parameter.group in _LAST else 3


def phrases(combinations: Sequence[Sequence[Parameter]], most: int | None = None) -> list[str]:
    """`θ2 with a2, α3` of each combination of parameters, with `and 24 others` beyond `most` phrases; single parameters
    in one phrase, last: `θ5; d5; backlash of joints 1, 2: each alone`.
    """
    phrases = [in_words(parameters) for parameters in combinations]
    alone = [each for own, parts in zip(combinations, phrases, strict=True) if len(parts) == 1 for each in own]
    found = [f"{parts[0]}{_WITH}{_cut(parts[1:], most)}" for parts in phrases if len(parts) > 1]
    parts = in_words(list(dict.fromkeys(alone)))
    several = len(alone) > 1
    return [*found, f"{'; '.join(parts)}{': each' if several else ''} alone"] if parts else found


def alike(phrases: Sequence[str]) -> list[str]:
    """Phrases with the same other parameters joined, and those that differ by one number alone: `θ7, d7 each with tool
    translation along X`; `d of link i with growth of link i, i = 3, 5`.
    """
    heads: dict[str, list[str]] = {}
    for phrase in phrases:
        head, _, others = phrase.partition(_WITH)
        heads.setdefault(others, []).append(head)
    shorter = [_headed(first, others) for others, first in heads.items()]
    forms: dict[str, list[str]] = {}
    for phrase in shorter:
        numbers = _NUMBER.findall(phrase)
        forms.setdefault(_NUMBER.sub("i", phrase) if len(set(numbers)) == 1 else phrase, []).append(phrase)
    return [_numbered(form, same) for form, same in forms.items()]


def _headed(heads: list[str], others: str) -> str:
    if not others:
        return "; ".join(heads)
    return f"{', '.join(heads)}{' each' if len(heads) > 1 else ''}{_WITH}{others}"


def _numbered(form: str, same: list[str]) -> str:
    if len(same) == 1:
        return same[0]
    return f"{form}, i = {', '.join(sorted((_NUMBER.findall(phrase)[0] for phrase in same), key=int))}"


def _cut(parts: list[str], most: int | None) -> str:
    if most is None or len(parts) <= most:
        return ", ".join(parts)
    return f"{', '.join(parts[: most - 1])} and {len(parts) - most + 1} others"
