"""The base of every row that a run records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol, Self, TypeVar, final

from pydantic import TypeAdapter, ValidationError

from cellctl.files import canonical_json

Json = Any
"""A JSON value; NaN and infinities are not allowed."""


@dataclass(frozen=True)
class Row:
    """A row of the journal. Derive a frozen dataclass from it; its fields are JSON, other such dataclasses, or tuples.

    KIND: its name in the journal. VERSION: counts changes that an older reader would misread. MEASUREMENT: it is a
    measured point of the run, and the result counts it under `points`. A field that is added later needs a default.
    """

    KIND: ClassVar[str]
    VERSION: ClassVar[int] = 1
    MEASUREMENT: ClassVar[bool] = False

    def data(self) -> dict[str, Json]:
        """The fields by name, as the journal keeps them."""
        return asdict(self)

    @classmethod
    def read(cls, data: Mapping[str, Json], version: int = 1) -> Self:
        """The row from `data` of `version`; unknown fields are ignored.

        Raises BadRow if a field is missing or has another type, or if the row has a newer version.
        """
        if version > cls.VERSION:
            raise BadRow(f"is of version {version}, and this program reads versions up to {cls.VERSION}")
        try:
            text = canonical_json(dict(cls.of_older(data, version)))
            row: Self = _reader(cls).validate_json(text, strict=True)
        except ValidationError as error:
            raise BadRow("; ".join(_words(detail) for detail in error.errors(include_url=False))) from None
        return row

    @classmethod
    def of_older(cls, data: Mapping[str, Json], version: int) -> Mapping[str, Json]:
        """`data` of an older `version` as this version has it. A class whose VERSION is above 1 overrides this."""
        return data


AnyRow = TypeVar("AnyRow", bound=Row)


@final
class BadRow(ValueError):
    """A row in the journal does not match its class; the text names the fields."""


class Rows(Protocol):
    """The rows of a run: a step's context and a `RunState` have them."""

    def recorded(self, kind: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of this class that count."""

    def all_recorded(self, *kinds: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of these classes of every attempt."""


_READERS: dict[type[Row], TypeAdapter[Any]] = {}


def _reader(kind: type[Row]) -> TypeAdapter[Any]:
    if kind not in _READERS:
        _READERS[kind] = TypeAdapter(kind)
    return _READERS[kind]


def _words(detail: Any) -> str:
    name = ".".join(str(part) for part in detail["loc"])
    if detail["type"] == "missing":
        return f"field '{name}' is missing"
    return f"field '{name}' holds {str(detail['input'])[:40]!r}, which is of another type"
