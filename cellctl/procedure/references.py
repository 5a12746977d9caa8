"""References in a procedure: `${name}`, `${name.field}`, `${name[3].x}`; a whole value each, no expressions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

_WHOLE = re.compile(r"\$\{([a-z][a-z0-9_]*)((?:\.[A-Za-z_][A-Za-z0-9_]*|\[[0-9]+\])*)\}")
_PART = re.compile(r"\.([A-Za-z_][A-Za-z0-9_]*)|\[([0-9]+)\]")


UNKNOWN: Final = object()
"""A value that is known only during the run."""


class UnresolvedReference(Exception):
    """A reference cannot be resolved: the name is unknown here, or its value has no such part."""


@final
@dataclass(frozen=True, slots=True)
class Reference:
    """`${name.part[3]}`: the first name, and the path after it (fields and list indices)."""

    name: str
    way: tuple[str | int, ...] = ()

    @classmethod
    def parse(cls, text: str) -> Reference:
        """Read `${…}`. Raises ValueError for anything else."""
        match = _WHOLE.fullmatch(text)
        if not match:
            raise ValueError(f"'{text}' is no reference")
        parts = _PART.finditer(match[2])
        return cls(match[1], tuple(int(part[2]) if part[1] is None else part[1] for part in parts))

    def __str__(self) -> str:
        way = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in self.way)
        return f"${{{self.name}{way}}}"


def resolve(value: Any, scope: Mapping[str, Any]) -> Any:
    """`value` with every reference replaced by its value in `scope` (name → JSON).

    Raises UnresolvedReference.
    """
    match value:
        case Reference():
            return _follow(value, scope)
        case dict():
            return {key: resolve(part, scope) for key, part in value.items()}
        case list():
            return [resolve(part, scope) for part in value]
        case _:
            return value


def references_in(value: Any, at: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], Reference]]:
    """Every reference in `value`, with its place under `at`."""
    match value:
        case Reference():
            yield at, value
        case dict():
            for key, part in value.items():
                yield from references_in(part, (*at, key))
        case list():
            for index, part in enumerate(value):
                yield from references_in(part, (*at, index))


def known_part(
    value: dict[str, Any], look_up: Callable[[Reference], Any]
) -> tuple[dict[str, Any], list[tuple[str | int, ...]]]:
    """`value` with the references that `look_up` resolves replaced, the others removed; and their places.

    A list with an unknown element is left out completely, since later indices would change.
    """
    unknown: list[tuple[str | int, ...]] = []
    return _prune(value, look_up, (), unknown), unknown


def _prune(value: Any, look_up: Callable[[Reference], Any], at: tuple[str | int, ...], unknown: list[Any]) -> Any:
    match value:
        case dict():
            parts = {key: _prune(part, look_up, (*at, key), unknown) for key, part in value.items()}
            return {key: part for key, part in parts.items() if part is not UNKNOWN}
        case list():
            found: list[Any] = []
            parts_of_list = [_prune(part, look_up, at, found) for part in value]
            unknown += [at] if found else []
            return UNKNOWN if found else parts_of_list
        case Reference():
            known = look_up(value)
            unknown += [at] if known is UNKNOWN else []
            return known
        case _:
            return value


def _follow(reference: Reference, scope: Mapping[str, Any]) -> Any:
    if reference.name not in scope:
        raise UnresolvedReference(f"{reference}: '{reference.name}' is not known here")
    value = scope[reference.name]
    for part in reference.way:
        value = _part_of(value, part, reference)
    return value


def _part_of(value: Any, part: str | int, reference: Reference) -> Any:
    if isinstance(part, str) and isinstance(value, Mapping) and part in value:
        return value[part]
    if isinstance(part, int) and isinstance(value, Sequence) and not isinstance(value, str) and part < len(value):
        return value[part]
    wanted = f"element {part}" if isinstance(part, int) else f"field '{part}'"
    raise UnresolvedReference(f"{reference}: there is no {wanted} in what it names")
