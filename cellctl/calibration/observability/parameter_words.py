"""Parameters in a person's words: `θ5`, `tool translation along X, Y`, `compliance of joint 2`, `centres of S1, S2`."""

from __future__ import annotations

import re
from collections.abc import Sequence

LINK = re.compile(r"(theta|d|a|alpha|beta)(\d+)")
_AXIS = re.compile(r"(turn|slide)_([xy])(\d+)")
_FRAME = re.compile(r"(tool|base)_([xyzabc])(?:@(.*))?")
_EFFECTS = (
    (re.compile(r"(tool)_deflection"), "tool deflection", ""),
    (re.compile(r"compliance(\d+)_\d+[xyz]"), "compliance", "joint"),
    (re.compile(r"compliance_load(\d+)"), "compliance under load", "joint"),
    (re.compile(r"harmonic(\d+)_[sc]1"), "once-per-turn error", "joint"),
    (re.compile(r"harmonic(\d+)_[sc]2"), "twice-per-turn error", "joint"),
    (re.compile(r"harmonic(\d+)_[sc](?:[3-9]|\d\d+)"), "ripple", "joint"),
    (re.compile(r"(discrepancy)\d+_[xyz]"), "discrepancy", ""),
    (re.compile(r"backlash(\d+)"), "backlash", "joint"),
    (re.compile(r"growth(\d+)"), "growth", "link"),
)
_WITH = " with "
_PLANE = "_plane"
_NUMBER = re.compile(r"\d+")
_OF_AXIS = {"turn": "tilt of axis {} about its", "slide": "place of axis {} along its"}
_GREEK = {"theta": "θ", "alpha": "α", "beta": "β"}
_TURNS = {"a": "Z", "b": "Y", "c": "X"}


def in_words(names: Sequence[str]) -> list[str]:
    """The parameters `names` as phrases, alike ones in one: links first, then tool and base, effects, points, lengths'
    zeros.
    """
    known = [*_links(names), *_axes(names), *_frames(names), *_effects(names), *_points(names), *_datums(names)]
    return known + [name for name in names if not _is_known(name)]


def phrases(combinations: Sequence[Sequence[str]], most: int | None = None) -> list[str]:
    """`θ2 with a2, α3` of each combination of parameters, with `and 24 others` beyond `most` phrases; those that stand
    alone in one, last: `θ5; d5; backlash of joints 1, 2: each alone`.
    """
    said = [in_words(names) for names in combinations]
    alone = [name for names, parts in zip(combinations, said, strict=True) if len(parts) == 1 for name in names]
    found = [f"{parts[0]}{_WITH}{_cut(parts[1:], most)}" for parts in said if len(parts) > 1]
    parts = in_words(list(dict.fromkeys(alone)))
    several = len(alone) > 1
    return [*found, f"{'; '.join(parts)}{': each' if several else ''} alone"] if parts else found


def alike(said: Sequence[str]) -> list[str]:
    """Phrases with the same others as one, and those that differ by one number alone: `θ7, d7 each with tool
    translation along X`; `d of link i with growth of link i, i = 3, 5`.
    """
    heads: dict[str, list[str]] = {}
    for phrase in said:
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


def of_the_arm(name: str) -> bool:
    """Whether a parameter belongs to a link or an axis, not to tool, base, an effect or a point."""
    return bool(LINK.fullmatch(name) or _AXIS.fullmatch(name))


def of_an_effect(name: str) -> bool:
    """Whether a parameter is an amount of an effect."""
    return any(pattern.fullmatch(name) for pattern, _, _ in _EFFECTS)


def _links(names: Sequence[str]) -> list[str]:
    found = [match for name in names if (match := LINK.fullmatch(name))]
    return [_GREEK.get(match[1], match[1]) + match[2] for match in found]


def _axes(names: Sequence[str]) -> list[str]:
    found = [match for name in names if (match := _AXIS.fullmatch(name))]
    letters: dict[tuple[str, str], list[str]] = {}
    for match in found:
        letters.setdefault((match[1], match[3]), []).append(match[2])
    return [f"{_OF_AXIS[kind].format(axis)} {', '.join(own)}" for (kind, axis), own in letters.items()]


def _frames(names: Sequence[str]) -> list[str]:
    found = [match for name in names if (match := _FRAME.fullmatch(name))]
    places = dict.fromkeys((match[1], match[3]) for match in sorted(found, key=lambda match: match[1] == "base"))
    return [words for frame, session in places for words in _frame(frame, session, found)]


def _frame(frame: str, session: str | None, found: Sequence[re.Match[str]]) -> list[str]:
    letters = [match[2] for match in found if (match[1], match[3]) == (frame, session)]
    slides = ", ".join(letter.upper() for letter in letters if letter in "xyz")
    turns = ", ".join(_TURNS[letter] for letter in letters if letter in _TURNS)
    where = f" in session {session}" if session else ""
    return [
        *([f"{frame} translation along {slides}{where}"] if slides else []),
        *([f"{frame} rotation about {turns}{where}"] if turns else []),
    ]


def _effects(names: Sequence[str]) -> list[str]:
    phrases = []
    for pattern, what, carrier in _EFFECTS:
        found = [match for name in names if (match := pattern.fullmatch(name))]
        numbers = list(dict.fromkeys(match[1] for match in found)) if carrier else []
        if found:
            plural = "s" if len(numbers) > 1 else ""
            phrases.append(f"{what} of {carrier}{plural} {', '.join(numbers)}" if carrier else what)
    return phrases


def _points(names: Sequence[str]) -> list[str]:
    found = list(dict.fromkeys(name.rpartition("_")[0] for name in names if _is_point(name)))
    points = [name for name in found if not name.endswith(_PLANE)]
    planes = [name.removesuffix(_PLANE) for name in found if name.endswith(_PLANE)]
    return [
        *([f"centre{'' if len(points) == 1 else 's'} of {', '.join(points)}"] if points else []),
        *([f"plane{'' if len(planes) == 1 else 's'} {', '.join(planes)}"] if planes else []),
    ]


def _datums(names: Sequence[str]) -> list[str]:
    datums = [name.removesuffix("_zero") for name in names if _is_datum(name)]
    return [f"zero{'' if len(datums) == 1 else 's'} of {', '.join(datums)}"] if datums else []


def _is_datum(name: str) -> bool:
    return name.endswith("_zero") and not _of_robot(name)


def _is_point(name: str) -> bool:
    return bool(re.search(r"_[xyz]$", name)) and not _of_robot(name)


def _of_robot(name: str) -> bool:
    return of_the_arm(name) or of_an_effect(name) or bool(_FRAME.fullmatch(name))


def _is_known(name: str) -> bool:
    return _of_robot(name) or _is_point(name) or _is_datum(name)
