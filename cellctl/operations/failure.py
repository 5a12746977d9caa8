"""An error as data: its exit code, and its problems with place and cure. For a console, an API, or another process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

from cellctl.devices.errors import DeviceError, DeviceUncertain
from cellctl.files import InputError, Problem
from cellctl.journal.journal_file import JournalError

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
