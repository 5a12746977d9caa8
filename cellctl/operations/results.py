"""A service's result as JSON and back; a failure as data: its exit code, its problems with place and cure.

The fields of a result's dataclass are the keys, in their order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Self, TypeVar, final

from pydantic import TypeAdapter

from cellctl.devices.errors import DeviceError, DeviceUncertain
from cellctl.files import InputError, Problem
from cellctl.journal.journal_file import JournalError

Result = TypeVar("Result")


def as_json(result: object) -> dict[str, Any]:
    """A dataclass as JSON has it."""
    kind: Any = type(result)
    content: dict[str, Any] = _adapter(kind).dump_python(result, mode="json")
    return content


def from_json(kind: type[Result], content: object) -> Result:
    """The inverse of `as_json`. Raises ValidationError."""
    wanted: Any = kind
    found: Result = _adapter(wanted).validate_python(content)
    return found


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Kept: to make one takes some milliseconds, and a list of results needs it for each."""
    return TypeAdapter(kind)


BAD_INPUT, DEVICE_FAILED, UNCERTAIN, ABORTED = 2, 3, 4, 130
MEANINGS = {
    0: "done",
    1: "done, and the verdict is not `better`",
    BAD_INPUT: "the input is wrong",
    DEVICE_FAILED: "failed",
    UNCERTAIN: "the state is uncertain: a person must check the cell",
    ABORTED: "aborted by the operator",
}


@final
@dataclass(frozen=True)
class Failure:
    """Why something was not done. code: the exit code of the command line. note: one remark for all problems."""

    code: int
    problems: tuple[Problem, ...]
    note: str = ""

    @classmethod
    def of(cls, error: Exception) -> Self:
        """The failure that `error` is on the command line."""
        match error:
            case InputError():
                return cls(BAD_INPUT, tuple(error.problems), error.note)
            case DeviceError():
                code = UNCERTAIN if isinstance(error, DeviceUncertain) else DEVICE_FAILED
                return cls(code, (Problem(error.device, 0, 0, error.what, error.cure),))
            case JournalError():
                return cls(BAD_INPUT, (Problem(str(error.path), 0, 0, error.what, error.cure),))
            case OSError():
                return cls(
                    BAD_INPUT, (Problem(str(error.filename or "this computer"), 0, 0, error.strerror or str(error)),)
                )
            case _:
                return cls.internal(f"{type(error).__name__}: {error}")

    @classmethod
    def internal(cls, what: str) -> Self:
        """An error of the program itself."""
        cure = "try the same on the command line with --debug, and report the traceback"
        return cls(DEVICE_FAILED, (Problem("cellctl", 0, 0, f"internal error: {what}", cure),))

    def __str__(self) -> str:
        return "\n".join([*map(str, self.problems), *([self.note] if self.note else [])])
