"""The meaning of a column's heading: which number it is, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

LENGTHS = {
    "mm": "mm", "millimeter": "mm", "millimetre": "mm", "cm": "cm", "m": "m", "meter": "m", "metre": "m",
    "um": "um", "µm": "um", "μm": "um", "inch": "inch", "inches": "inch", "in": "inch", "zoll": "inch", '"': "inch",
}  # fmt: skip
ANGLES = {"deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "grad": "deg", "rad": "rad", "radian": "rad"}
_UNITS = {**LENGTHS, **ANGLES}
_BRACKETED = re.compile(r"(?P<words>.*?)\s*(?:\[\s*(?P<a>[^\]]+?)\s*\]|\(\s*(?P<b>[^)]+?)\s*\)|/\s*(?P<c>\S+?))\s*")
_TRAILING = re.compile(r"(?P<words>.*?[^\W_])[\s_]+(?:in\s+)?(?P<a>mm|cm|um|µm|inch|deg|rad|°)\s*", re.IGNORECASE)
_WORDS = re.compile(r"[a-zäöüßθσ]+|\d+", re.IGNORECASE)
_NAMES = {
    "name", "names", "nr", "no", "num", "number", "nummer", "punkt", "punktnummer", "punktname", "pkt", "pt", "point",
    "points", "id", "label", "bezeichnung", "p",
    "pos", "position", "messpunkt", "target", "targets", "feature",
}  # fmt: skip
_GROUPS = {"collection", "group", "gruppe"}
_POSITION = {
    "pos", "position", "coord", "coordinate", "koordinate", "wert", "value", "measured", "measurement", "meas",
    "actual", "act", "ist", "gemessen", "messwert", "tracker", "tcp", "point", "punkt",
}  # fmt: skip
_JOINT = re.compile(r"(?:joint|achse|axis|gelenk|theta|θ|[ajq])[\s_.-]*(?:angle|pos|position|winkel)?[\s_.-]*(\d{1,2})")
_ORIENTATION = {"A", "B", "C", "QW", "QX", "QY", "QZ", "RX", "RY", "RZ"}
_REMARKS = {
    "remark",
    "remarks",
    "bemerkung",
    "bemerkungen",
    "comment",
    "comments",
    "kommentar",
    "note",
    "notes",
    "notiz",
}
_SIGMA = {"s", "sigma", "σ", "std", "stdev", "stddev", "standard", "standardabweichung"}
_DEVIATION = {"dev", "deviation"}
_UNCERTAINTY = {"u", "unc", "uncertainty", "uncertainties", "unsicherheit"}
_ONE_WORD = re.compile(r"(?P<kind>sigma|std|unc|[suσ])(?P<axis>[xyz])", re.IGNORECASE)
_TIMES = {"time", "stamp", "timestamp", "zeit", "uhrzeit", "zeitstempel", "measured", "measurement"}
_DATES = {"date", "datum"}


@final
@dataclass(frozen=True, slots=True)
class Heading:
    """A column: which of the data set's it is (`name`, `A1`, `J1`, `q1`, `X`, …; empty: unknown), unit or empty.

    `UX`…: an uncertainty of unknown coverage. `collection`, `group`, `date`: parts of a name or a time.
    """

    column: str
    unit: str = ""


def heading(text: str) -> Heading:
    """The meaning of a heading. `J…`: a joint whose heading does not state degrees or radians."""
    words, unit = _split(text)
    letters = [word.casefold() for word in _WORDS.findall(words)]
    if words.strip() == "#" or (letters and set(letters) <= _NAMES):
        return Heading("name")
    if part := _part_of_name_or_time(set(letters)):
        return Heading(part)
    axes = [word for word in letters if word in ("x", "y", "z")]
    if spread := _spread(words, letters, axes):
        return Heading(spread, unit)
    if len(axes) == 1 and set(letters) - set(axes) <= _POSITION and unit not in ANGLES.values():
        return Heading(axes[0].upper(), unit)
    joint = _JOINT.fullmatch(words.strip(" #").casefold())
    if joint and unit not in LENGTHS.values():
        letter = words.strip(" #")[0]
        return Heading(
            f"{'A' if letter in 'Aa' and _is_a(words) else 'q' if letter == 'q' else 'J'}{int(joint[1])}", unit
        )
    plain = words.strip().upper()
    if plain in _ORIENTATION:
        return Heading(plain, unit)
    return Heading("remark" if letters and set(letters) <= _REMARKS else "", unit)


def _part_of_name_or_time(letters: set[str]) -> str:
    """`collection`, `group`, `name` (of `Collection::Group::Point`), `time` or `date`, empty where it is none."""
    if letters & _GROUPS:
        if letters & _NAMES - {"name", "names"}:
            return "name" if letters <= _GROUPS | _NAMES else ""
        return ("collection" if "collection" in letters else "group") if letters <= _GROUPS | {"name"} else ""
    if letters & (_TIMES - {"measured", "measurement"}) and letters <= _TIMES | _DATES:
        return "time"
    return "date" if letters and letters <= _DATES else ""


def _spread(words: str, letters: Sequence[str], axes: Sequence[str]) -> str:
    """`sX`… for a standard deviation, `UX`… for an uncertainty of unknown coverage; empty where it is neither.

    `Deviation X` and `Dev X` are neither: actual minus nominal.
    """
    one = _ONE_WORD.fullmatch(words.strip(" #"))
    if one:
        return f"{'U' if one['kind'].casefold() in _UNCERTAINTY else 's'}{one['axis'].upper()}"
    rest = set(letters) - set(axes)
    if len(axes) != 1:
        return ""
    if rest & _SIGMA and rest <= _SIGMA | _DEVIATION:
        return f"s{axes[0].upper()}"
    return f"U{axes[0].upper()}" if rest & _UNCERTAINTY and rest <= _UNCERTAINTY | {"coordinate"} else ""


def is_units_row(cells: Sequence[str]) -> bool:
    """Whether a row under the headings states units: `;mm;mm;mm`, `[mm]`."""
    filled = [cell for cell in cells if cell]
    return bool(filled) and all(cell.strip("[]() ").casefold() in _UNITS for cell in filled)


def unit_of(cell: str) -> str:
    """The unit stated by a cell of a units row."""
    return _UNITS.get(cell.strip("[]() ").casefold(), "")


def places(cells: Sequence[str], columns: Mapping[str, str]) -> dict[str, list[tuple[int, str]]]:
    """Columns of the data set → their places in a row of headings, with the unit. columns: what the user named."""
    named = {source.casefold(): target for target, source in columns.items()}
    found: dict[str, list[tuple[int, str]]] = {}
    for place, cell in enumerate(cells):
        target = named.get(cell.casefold())
        stated = Heading(target, _split(cell)[1]) if target else heading(cell)
        if stated.column and (target or stated.column not in columns):
            found.setdefault(stated.column, []).append((place, stated.unit))
    return found


def _is_a(words: str) -> bool:
    return re.fullmatch(r"#?\s*[Aa][\s_.-]*\d+", words.strip()) is not None


def _split(text: str) -> tuple[str, str]:
    """A heading's words, and its unit where it states a known one."""
    for pattern in (_BRACKETED, _TRAILING):
        found = pattern.fullmatch(text.strip())
        if found:
            unit = next(each for name, each in found.groupdict().items() if name != "words" and each)
            if unit.casefold() in _UNITS:
                return found["words"], _UNITS[unit.casefold()]
    return text, ""
