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
    (re.compile(r"backlash(\d+)"), "backlash", "joint"),
    (re.compile(r"growth(\d+)"), "growth", "link"),
)
_GREEK = {"theta": "θ", "alpha": "α", "beta": "β"}
_TURNS = {"a": "Z", "b": "Y", "c": "X"}


def in_words(names: Sequence[str]) -> list[str]:
    """The parameters `names` as phrases, alike ones in one: links first, then tool and base, effects, points, lengths'
    zeros.
    """
    known = [*_links(names), *_axes(names), *_frames(names), *_effects(names), *_points(names), *_datums(names)]
    return known + [name for name in names if not _is_known(name)]


def of_the_arm(name: str) -> bool:
    """Whether a parameter belongs to a link or an axis, not to tool, base, an effect or a point."""
    return bool(LINK.fullmatch(name) or _AXIS.fullmatch(name))


def _links(names: Sequence[str]) -> list[str]:
    found = [match for name in names if (match := LINK.fullmatch(name))]
    return [_GREEK.get(match[1], match[1]) + match[2] for match in found]


def _axes(names: Sequence[str]) -> list[str]:
    found = [match for name in names if (match := _AXIS.fullmatch(name))]
    kinds = {"turn": "tilt", "slide": "place"}
    return [f"{kinds[match[1]]} of axis {match[3]} {'about' if match[1] == 'turn' else 'along'} its {match[2]}"
            for match in found]  # fmt: skip


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
    points = list(dict.fromkeys(name.rpartition("_")[0] for name in names if _is_point(name)))
    return [f"centre{'' if len(points) == 1 else 's'} of {', '.join(points)}"] if points else []


def _datums(names: Sequence[str]) -> list[str]:
    datums = [name.removesuffix("_zero") for name in names if _is_datum(name)]
    return [f"zero{'' if len(datums) == 1 else 's'} of {', '.join(datums)}"] if datums else []


def _is_datum(name: str) -> bool:
    return name.endswith("_zero") and not _of_robot(name)


def _is_point(name: str) -> bool:
    return bool(re.search(r"_[xyz]$", name)) and not _of_robot(name)


def _of_robot(name: str) -> bool:
    known = (LINK, _AXIS, _FRAME, *(pattern for pattern, _, _ in _EFFECTS))
    return any(pattern.fullmatch(name) for pattern in known)


def _is_known(name: str) -> bool:
    return _of_robot(name) or _is_point(name) or _is_datum(name)
