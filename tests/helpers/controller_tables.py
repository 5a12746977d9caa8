"""The tables of a controller, written by hand from docs/reference/eki-channel.md: what a driver's pushes meet."""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass, field

Row = tuple[str, ...]
"""A row as it came: number, six nominal, six compensated, each as text."""


@dataclass
class Kept:
    """A table on the controller: `rows` it is to have, `sum` announced, `lines` arrived."""

    id: str
    rows: int
    sum: str
    lines: list[Row] = field(default_factory=list)


@dataclass
class ControllerTables:
    """Takes the table commands and answers as the reference says; `tampered` spoils what is read back."""

    serial: str = "SIM-000007"
    active: Kept | None = None
    previous: Kept | None = None
    staged: Kept | None = None
    operations: list[str] = field(default_factory=list)
    tampered: dict[str, str] = field(default_factory=dict)
    forgets_before: str = ""
    blocks: list[int] = field(default_factory=list)

    def answer(self, operation: str, document: str) -> tuple[int, str]:
        """Code and further content of the reply."""
        self.operations.append(operation)
        if operation == self.forgets_before:
            self.staged = None
        handler = getattr(self, f"_{operation.lower()}")
        return handler(document)

    def _tstage(self, document: str) -> tuple[int, str]:
        head = _attributes(document, "Table")
        if head["Serial"] != self.serial:
            return 40, ""
        if not 0 < int(head["Rows"]) <= 500:
            return 43, ""
        self.staged = Kept(head["Id"], int(head["Rows"]), head["Sum"])
        return 0, ""

    def _tblock(self, document: str) -> tuple[int, str]:
        if self.staged is None:
            return 42, ""
        head, rows = _attributes(document, "Block"), _rows(document)
        self.blocks.append(len(rows))
        if int(head["First"]) != len(self.staged.lines) + 1 or not 0 < len(rows) == int(head["Count"]) <= 10:
            return 42, ""
        if _sum(rows) != head["Sum"]:
            return 41, ""
        self.staged.lines += rows
        return 0, ""

    def _tread(self, document: str) -> tuple[int, str]:
        table = self.staged or self.active
        if table is None:
            return 42, ""
        head = _attributes(document, "Block")
        first, count = int(head["First"]), int(head["Count"])
        rows = table.lines[first - 1 : first - 1 + count]
        text = f'<Block First="{first}" Count="{len(rows)}" Sum="{_sum(rows)}"/>' + "".join(map(_element, rows))
        for old, new in self.tampered.items():
            text = text.replace(old, new)
        return 0, text

    def _tactivate(self, document: str) -> tuple[int, str]:
        asked = _attributes(document, "Table")
        if self.staged is None:
            return (0 if self.active and self.active.id == asked["Id"] else 42), ""
        if len(self.staged.lines) != self.staged.rows:
            return 42, ""
        if asked["Id"] != self.staged.id or not asked["Sum"] == self.staged.sum == _sum(self.staged.lines):
            return 41, ""
        self.active, self.previous, self.staged = self.staged, self.active, None
        return 0, ""

    def _trollback(self, _: str) -> tuple[int, str]:
        if self.active is None and self.previous is None:
            return 42, ""
        self.active, self.previous = self.previous, self.active
        return 0, ""

    def _tstate(self, _: str) -> tuple[int, str]:
        kept = {"Active": self.active, "Previous": self.previous}
        text = "".join(
            f'<{tag} Id="{table.id}" Rows="{table.rows}" Sum="{_sum(table.lines)}"/>'
            for tag, table in kept.items()
            if table
        )
        if self.staged:
            text += f'<Staged Id="{self.staged.id}" Rows="{self.staged.rows}" Taken="{len(self.staged.lines)}"/>'
        return 0, text


def _attributes(document: str, tag: str) -> dict[str, str]:
    found = re.search(rf"<{tag} ([^>]*)/>", document)
    assert found, f"no <{tag}> in {document}"
    return dict(re.findall(r'(\w+)="([^"]*)"', found[1]))


def _rows(document: str) -> list[Row]:
    return [
        (number, *re.findall(r'A[1-6]="([^"]*)"', body))
        for number, body in re.findall(r'<R N="(\d+)">(.*?)</R>', document)
    ]


def _sum(rows: list[Row]) -> str:
    text = "".join(";".join(row) + "\n" for row in rows)
    return f"{zlib.crc32(text.encode()):08X}"


def _element(row: Row) -> str:
    def joints(tag: str, values: Row) -> str:
        return f"<{tag} " + " ".join(f'A{i}="{value}"' for i, value in enumerate(values, 1)) + "/>"

    return f'<R N="{row[0]}">{joints("Q", row[1:7])}{joints("C", row[7:])}</R>'
