"""Settings and faults that a simulator declares: their kinds, limits and defaults, read from the cell file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, final

from sims.section import Section


@final
@dataclass(frozen=True, slots=True)
class Setting:
    """One setting: `Setting("cycle_ms", "whole", 4, among=(4, 12))`.

    `default`: where the file has none; None: whoever takes it knows what that means. `least`: the smallest number
    (a whole number is never below 0). `among`: the only values. `step`: of which a number is a multiple. `what`: one
    sentence for people. `measured`: step and figure of a commissioning that give its value, `telegrams.jitter_ms`.
    """

    name: str
    kind: Literal["number", "whole", "word"]
    default: float | str | None = None
    least: float | None = None
    among: tuple[float | str, ...] = ()
    step: int | None = None
    what: str = ""
    measured: str = ""

    def read(self, section: Section) -> Any:
        """Its value in a section of the cell file; errors are noted there."""
        if section.entries.get(self.name) is None:
            return self.default
        if self.kind == "word":
            return section.word(self.name, among=[str(word) for word in self.among])
        if self.kind == "whole":
            value: float = section.whole(self.name, least=int(self.least or 0))
        else:
            value = section.number(self.name, least=-float("inf") if self.least is None else self.least)
        if self.among and value not in self.among:
            section.note(self.name, f"{' or '.join(map(str, self.among))} is expected, not {value}")
        if self.step and value % self.step:
            section.note(self.name, f"a multiple of {self.step} is expected, not {value}")
        return value

    def schema(self) -> dict[str, Any]:
        """What the JSON Schema says of it."""
        kinds = {"number": "number", "whole": "integer", "word": "string"}
        found: dict[str, Any] = {
            "description": self.what or None,
            **({"enum": list(self.among)} if self.among else {"type": kinds[self.kind]}),
            "minimum": None if self.among else self.least if self.kind != "whole" else self.least or 0,
            "multipleOf": self.step,
            "default": self.default,
        }
        return {key: value for key, value in found.items() if value is not None}


FOR_MS = Setting("for_ms", "number", None, 0.0, what="Without it a fault stays.")


@final
@dataclass(frozen=True, slots=True)
class FaultKind:
    """A fault that there can be. `momentary`: it happens and is over, only its start is reported."""

    name: str
    what: str
    settings: tuple[Setting, ...] = ()
    momentary: bool = False


def read_settings(settings: tuple[Setting, ...], section: Section) -> dict[str, Any]:
    """Name → value of each setting; errors, and unknown keys, are noted in the section."""
    section.only(setting.name for setting in settings)
    return {setting.name: setting.read(section) for setting in settings}
