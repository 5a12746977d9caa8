"""Computing in another process: one operation of a fixed table; JSON in, lines of JSON out; nothing is pickled.

`python -P -m cellctl.operations.worker OPERATION` reads the request, a JSON object, from stdin. Each line of its
output is `{"doing": …, "share": …}` or `{"line": …}`, of folds with `"fold": …`; the last one is `{"result": …}` or
`{"failure": …}`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, TypeAlias

from cellctl.operations.results import ABORTED, Failure, as_json, from_json
from cellctl.signals import sigterm_as_sigint

Tell: TypeAlias = Callable[[dict[str, Any]], None]
Operation: TypeAlias = Callable[[dict[str, Any], Tell], Any]
"""Takes the request and what reports a line; its result is JSON."""

OPERATIONS: dict[str, str] = {
    "act_on_table": "cellctl.operations.worker_operations:act_on_table",
    "check": "cellctl.operations.checking:check_requested",
    "compensate": "cellctl.operations.worker_operations:compensate",
    "examine": "cellctl.operations.doctor:examine_requested",
    "export": "cellctl.operations.worker_operations:export",
    "fit": "cellctl.operations.worker_operations:fit",
    "folds": "cellctl.operations.worker_operations:folds",
    "look_at_table": "cellctl.operations.worker_operations:look_at_table",
    "replay": "cellctl.operations.worker_operations:replay",
    "report": "cellctl.operations.worker_operations:report",
    "understand": "cellctl.operations.worker_operations:understand",
}
"""Operation → `module:function`. A check and an examination need little: they do not import the others."""

WORKER = (sys.executable, "-P", "-m", "cellctl.operations.worker")
"""The command line of the process, without its operation."""

_MOST_WORDS = 1000

NICENESS = 10
"""A job computes with less priority than a run beside it."""

WAITED_FOR = frozenset({"folds"})
"""Operations for a process that waits for them: they have its priority."""


class OperationFailed(Exception):
    """An operation in another process failed."""

    def __init__(self, failure: Failure) -> None:
        self.failure = failure
        super().__init__(str(failure))


async def result_of(operation: str, request: Mapping[str, Any]) -> Any:
    """The result of an operation of `OPERATIONS` with a JSON `request`, in a process of its own.

    If this call is cancelled, the process is ended. Raises OperationFailed.
    """
    piped = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(*WORKER, operation, stdin=piped, stdout=piped, stderr=piped)
    try:
        out, errors = await process.communicate(json.dumps(request).encode())
    except asyncio.CancelledError:
        process.terminate()
        await process.wait()
        raise
    lines = out.splitlines()
    last: dict[str, Any] = json.loads(lines[-1]) if lines else {}
    if "result" in last:
        return last["result"]
    if "failure" in last:
        raise OperationFailed(from_json(Failure, last["failure"]))
    said = errors.decode(errors="replace").strip()
    raise OperationFailed(Failure.internal(f"the process ended with {process.returncode}: {said[-_MOST_WORDS:]}"))


def main(operations: Mapping[str, str] = OPERATIONS) -> int:
    """Run the operation that the command line names. Returns its exit code."""
    sigterm_as_sigint()
    tell = _teller()
    try:
        module, name = operations[sys.argv[1]].split(":")
        request = json.load(sys.stdin)
        os.nice(0 if sys.argv[1] in WAITED_FOR else NICENESS)
        operation: Operation = getattr(import_module(module), name)
        tell({"result": operation(request, tell)})
    except KeyboardInterrupt:
        tell({"failure": as_json(Failure(ABORTED, ()))})
        return ABORTED
    except Exception as error:
        failure = Failure.of(error)
        tell({"failure": as_json(failure)})
        return failure.code
    return 0


def _teller() -> Tell:
    """Writes lines to this process's stdout, which is kept free of other output; a console that ended is ignored."""
    lines = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def tell(line: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):
            print(json.dumps(line), file=lines, flush=True)

    return tell


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    os._exit(code)  # what a closed pipe has kept in a buffer is not written again
