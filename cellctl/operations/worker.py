"""The process of a job: calls one operation of a fixed table; JSON in, lines of JSON out. Nothing is pickled.

`python -P -m cellctl.console.worker OPERATION` reads the request, a JSON object, from stdin. Each line of its output is
`{"doing": …, "share": …}` or `{"line": …}`; the last one is `{"result": …}` or `{"failure": …}`.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, TypeAlias

from cellctl.operations.failure import ABORTED, Failure

Tell: TypeAlias = Callable[[dict[str, Any]], None]
Operation: TypeAlias = Callable[[dict[str, Any], Tell], Any]
"""Takes the request and what reports a line; its result is JSON."""

OPERATIONS: dict[str, str] = {
    "act_on_table": "cellctl.console.worker_operations:act_on_table",
    "compensate": "cellctl.console.worker_operations:compensate",
    "export": "cellctl.console.worker_operations:export",
    "fit": "cellctl.console.worker_operations:fit",
    "look_at_table": "cellctl.console.worker_operations:look_at_table",
    "replay": "cellctl.console.worker_operations:replay",
    "report": "cellctl.console.worker_operations:report",
    "understand": "cellctl.console.worker_operations:understand",
}
"""Operation → `module:function`."""

NICENESS = 10
"""A job computes with less priority than a run beside it."""


def main(operations: Mapping[str, str] = OPERATIONS) -> int:
    """Run the operation that the command line names. Returns its exit code."""
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    tell = _teller()
    try:
        module, name = operations[sys.argv[1]].split(":")
        request = json.load(sys.stdin)
        os.nice(NICENESS)
        operation: Operation = getattr(import_module(module), name)
        tell({"result": operation(request, tell)})
    except KeyboardInterrupt:
        tell({"failure": Failure(ABORTED, ()).to_json()})
        return ABORTED
    except Exception as error:
        failure = Failure.of(error)
        tell({"failure": failure.to_json()})
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
