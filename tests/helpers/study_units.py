"""Units of a study that a test can hold, with the process that computes them."""

import os
import threading
from pathlib import Path
from typing import Any


def held(folder: str, number: int) -> dict[str, Any]:
    """Begin unit `number`: write it and the process into the file `begun`; wait while the file `hold-NUMBER` exists."""
    place = Path(folder)
    with (place / "begun").open("a") as file:
        file.write(f"{number} {os.getpid()}\n")
    while (place / f"hold-{number}").exists():
        threading.Event().wait(0.02)
    return {"root": number**0.5}


def ends_its_process(folder: str, number: int) -> dict[str, Any]:
    """End the worker without a word."""
    os._exit(9)
