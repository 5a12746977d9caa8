"""The program's desk for compensation tables: a request in, a reply's code, text and elements out."""

from __future__ import annotations

from typing import final

from sims.krc.eki_messages import Code
from sims.krc.table_requests import Activate, Request, Rollback, WrongSerial, do
from sims.krc.tables import BadSize, BadSum, TableRefused, Tables
from sims.memory import Memory
from sims.scene.motions import Joints

_CODES = {BadSum: Code.BAD_SUM, BadSize: Code.BAD_SIZE}


@final
class TableDesk:
    """The tables of the controller with this serial. What is active is remembered before it is answered."""

    def __init__(self, tables: Tables, serial: str, memory: Memory) -> None:
        self._tables = tables
        self._memory = memory
        self._serial = serial

    def ask(self, request: Request) -> tuple[Code, str, str]:
        """Execute the request or refuse it; returns code, text, the reply's inner elements."""
        try:
            inner = do(request, self._tables, self._serial)
        except WrongSerial as error:
            return Code.WRONG_SERIAL, str(error), ""
        except TableRefused as error:
            return _CODES.get(type(error), Code.NO_SUCH_ROWS), str(error), ""
        if isinstance(request, Activate | Rollback):
            self._memory.save()
        return Code.DONE, "", inner

    def target(self, row: int) -> Joints | None:
        """Where PTPT goes, degrees; None where the active table has no such row."""
        return self._tables.target(row)

    def forget_staged(self) -> None:
        """The controller restarts."""
        self._tables.forget_staged()
