"""Which test shows which rule of docs/reference/probe-protocol.md, for the table in README.md."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import TypeVar

Test = TypeVar("Test", bound=Callable[..., object])


def rule(text: str) -> Callable[[Test], Test]:
    """The rule that a test shows, in one sentence."""

    def mark(test: Test) -> Test:
        vars(test)["rule"] = text
        return test

    return mark


def table(*modules: ModuleType) -> str:
    """Rule, implementations, test: as Markdown, in the order of the tests."""
    rows = ["| rule | firmware | simulator | test |", "|---|---|---|---|"]
    for module in modules:
        for name, test in vars(module).items():
            if text := getattr(test, "rule", ""):
                both = "rig" in inspect.signature(test).parameters
                file = (module.__file__ or "").rsplit("/", 1)[-1]
                rows.append(f"| {text} | yes | {'yes' if both else '–'} | `{file}` `{name}` |")
    return "\n".join(rows) + "\n"


README = Path(__file__).parent / "README.md"
BEGIN, END = "<!-- rules -->\n", "<!-- end of rules -->\n"


def with_table(text: str, *modules: ModuleType) -> str:
    """The text of README.md with the table of these modules."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{table(*modules)}\n{END}{after}"
