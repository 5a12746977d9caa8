"""Exit codes, and the error block on stderr: what is wrong, where, and what to do."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from typing import TYPE_CHECKING, final

import typer

if TYPE_CHECKING:  # `--help` does not wait for the journal
    from cellctl.files.problems import InputError

NOTHING_MOVED = "nothing was moved"
SHOWN = 20
"""Maximum number of errors shown; further ones are counted."""


@final
class Exit(IntEnum):
    """How a call of `cellctl` ends."""

    GOOD = 0
    NOT_BETTER = 1
    BAD_INPUT = 2
    DEVICE_FAILED = 3
    UNCERTAIN = 4
    ABORTED = 130


@final
class Interrupted(Exception):
    """The operator pressed Ctrl-C."""


@contextmanager
def adding(words: str) -> Iterator[None]:
    """Add `words` ("nothing was moved") to an error, or an unreachable or occupied device, in a verb that can move.

    Verbs without motion add no words.
    """
    from cellctl.devices.errors import DeviceBusy, DeviceUnreachable  # `--help` does not wait for them
    from cellctl.files.problems import InputError  # as they

    try:
        yield
    except (InputError, DeviceUnreachable, DeviceBusy) as error:
        error.add_note(words)
        raise


def exit_code_of(call: Callable[[], object]) -> int:
    """Run `call`; print errors on stderr and convert them to an exit code."""
    try:
        result = call()
        sys.stdout.flush()
        return result if isinstance(result, int) else Exit.GOOD
    except typer.Exit as end:
        return end.exit_code
    except typer.Abort:
        return _ended("aborted", Exit.ABORTED)
    except (KeyboardInterrupt, Interrupted):
        return _ended("aborted by the operator", Exit.ABORTED)
    except Exception as error:
        return _ended_by(error)


def _ended_by(error: Exception) -> int:
    """Print `error` by its kind."""
    from cellctl.devices.errors import DeviceBusy, DeviceError, DeviceUncertain, DeviceUnreachable  # as in `adding`
    from cellctl.files.problems import InputError  # as in `adding`
    from cellctl.journal.journal_file import JournalError  # as in `adding`

    match error:
        case InputError():
            return _ended(errors_text(error), Exit.BAD_INPUT)
        case DeviceUncertain():
            return _ended(str(error), Exit.UNCERTAIN)
        case DeviceUnreachable() | DeviceBusy():
            return _ended("\n    ".join([str(error), *_notes(error)]), Exit.DEVICE_FAILED)
        case DeviceError():
            return _ended(str(error), Exit.DEVICE_FAILED)
        case JournalError():
            return _ended(str(error), Exit.BAD_INPUT)
        case _:
            return _other(error)


def errors_text(error: InputError) -> str:
    """The number of errors, the first of them, those alike as one, and the common note."""
    count = len(error.problems)
    lines = [", ".join([f"{count} error{'s' * (count > 1)}", *_notes(error)])]
    shown = error.grouped
    lines += [str(problem) for problem in shown[:SHOWN]]
    if len(shown) > SHOWN:
        lines.append(f"… and {len(shown) - SHOWN} more")
    return "\n".join([*lines, *([f"    {error.note}"] if error.note else [])])


def _notes(error: Exception) -> list[str]:
    return list(getattr(error, "__notes__", ()))


def _other(error: Exception) -> int:
    show = getattr(error, "format_message", None)  # click's usage errors
    if show:
        context = getattr(error, "ctx", None)
        usage = f"\n    {context.get_usage()}" if context else ""
        return _ended(show() + usage, Exit.BAD_INPUT)
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return _ended(f"{where}{error.strerror or error}", Exit.BAD_INPUT)
    if os.environ.get("CELLCTL_DEBUG"):
        traceback.print_exc()
    what = f"internal error: {type(error).__name__}: {error}"
    return _ended(f"{what}\n    run again with --debug and report the traceback", Exit.DEVICE_FAILED)


def _ended(text: str, code: Exit) -> int:
    print(f"cellctl: {text}", file=sys.stderr)
    return code
