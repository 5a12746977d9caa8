"""The generated data list CELLCTL_KVP as the reference has it: the job, the tables, what the program tells."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

from sims.scene.motions import Joints
from sims.varproxy.values import Bool, Chars, Int, Structure
from sims.varproxy.variables import Data, Variable

VERSION = 1
BANKS, ROWS, AXES = 3, 500, 6

_ANGLES = tuple(f"A{axis}" for axis in range(1, AXES + 1))
_WEIGHED = ("NUMBER", "ROW", "PERCENT", *_ANGLES)

JOB = Structure("KV_JOB_T", {name: Int() for name in (*_WEIGHED, "CHECK")})
BANK = Structure("KV_BANK_T", {"ID": Chars(64), "SUM": Chars(8), "ROWS": Int(), "TAKEN": Int()})
ROW = Structure("KV_ROW_T", {f"{letter}{axis}": Int() for letter in "NC" for axis in range(1, AXES + 1)})


@final
class DataList:
    """Its variables, by capital letters in `variables`."""

    def __init__(self) -> None:
        self.version = Data(Int(), values={(): VERSION})
        self.allow_t1 = Data(Bool())
        self.go, self.done, self.outcome = (Data(Int()) for _ in range(3))
        self.job = Data(JOB)
        self.bank = Data(BANK, (BANKS,))
        self.table = Data(ROW, (BANKS, ROWS))
        self.roles = Data(Int())
        self.variables: dict[str, Variable] = {
            "KV_VERSION": self.version,
            "KV_ALLOW_T1": self.allow_t1,
            "KV_GO": self.go,
            "KV_DONE": self.done,
            "KV_OUTCOME": self.outcome,
            "KV_JOB": self.job,
            "KV_BANK": self.bank,
            "KV_TAB": self.table,
            "KV_ROLES": self.roles,
        }

    def job_fits(self, number: int) -> bool:
        """Whether the job is the one of this number, and its check is right."""
        job = self.job.get()
        total = sum(weight * job[name] for weight, name in enumerate(_WEIGHED, 1))
        return bool(job["NUMBER"] == number and job["CHECK"] == total)

    def target(self) -> Joints | None:
        """Where the job goes, degrees; None where the active table has no such row."""
        job = self.job.get()
        if not job["ROW"]:
            return tuple(job[name] / 10_000 for name in _ANGLES)
        place = self.roles.get() // 100
        if not 1 <= place <= BANKS or not 1 <= job["ROW"] <= min(ROWS, self.bank.get(place)["TAKEN"]):
            return None
        row = self.table.get(place, job["ROW"])
        return tuple(row[f"C{axis}"] / 1_000_000 for axis in range(1, AXES + 1))

    def state(self) -> dict[str, Any]:
        """The tables, as JSON has them."""
        return {
            "roles": self.roles.get(),
            "banks": {str(place): self.bank.get(place) for place in range(1, BANKS + 1)},
            "rows": [[*index, *row.values()] for index, row in self.table.values.items()],
        }

    def recall(self, state: Mapping[str, Any]) -> None:
        """The tables of a `state` that was kept. Raises ValueError, TypeError, LookupError, AttributeError."""
        self.roles.values[()] = int(state["roles"])
        for place, bank in state["banks"].items():
            self.bank.values[(int(place),)] = {
                "ID": str(bank["ID"]),
                "SUM": str(bank["SUM"]),
                "ROWS": int(bank["ROWS"]),
                "TAKEN": int(bank["TAKEN"]),
            }
        for place, number, *angles in state["rows"]:
            self.table.values[(int(place), int(number))] = dict(zip(ROW.fields, map(int, angles), strict=True))
