"""The words of URScript, and where one program in a stream of text ends and the next begins."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

_WORD = re.compile(
    r"""[ \t\r]*(?:
        (?P<comment>\#[^\n]*)
      | (?P<label>\$[^\n]*)
      | (?P<end>\n)
      | (?P<number>0x[0-9a-fA-F]+|(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?)
      | (?P<text>"[^"\n]*"|'[^'\n]*')
      | (?P<name>[A-Za-z_]\w*)
      | (?P<sign><=|>=|==|!=|[-+*/%<>=()\[\],:])
      | (?P<other>.)
    )""",
    re.VERBOSE,
)
OPENING = ("def", "thread", "sec", "if", "while")


@final
@dataclass(frozen=True, slots=True)
class Word:
    """kind: number, text, name, sign, end (of a line), or other."""

    kind: str
    text: str
    line: int


def words(text: str) -> Iterator[Word]:
    """The words of a text; comments and labels are left out."""
    line, place = 1, 0
    while place < len(text):
        match = _WORD.match(text, place)
        if match is None or match.lastgroup is None:
            return
        place = match.end()
        if match.lastgroup not in ("comment", "label"):
            yield Word(match.lastgroup, match[match.lastgroup], line)
        line += match.lastgroup == "end"


@final
class ScriptStream:
    """Cuts what a client sends into programs: a block from its `def` or `sec` to its `end`, or one line."""

    LONGEST = 4_000_000

    def __init__(self) -> None:
        self._rest = b""
        self._lines: list[str] = []
        self._depth = 0

    def feed(self, data: bytes) -> Iterator[str]:
        """The programs that `data` completes."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-self.LONGEST :]
        for raw in lines:
            line = raw.decode("utf-8", "replace")
            first = re.match(r"\s*([A-Za-z_]\w*)?", line)
            word = (first and first[1]) or ""
            bare = line.partition("#")[0].strip()
            if not bare and not self._lines:
                continue
            self._lines.append(line)
            self._depth += word in OPENING
            self._depth -= word == "end"
            if self._depth <= 0:
                program, self._lines, self._depth = "\n".join(self._lines) + "\n", [], 0
                yield program
