"""The procedure of the kit, and a history of its runs."""

from pathlib import Path

from cellctl.installed import Campaigns, History


class Count:
    """How many runs there are."""

    def __init__(self, runs: Path, first: int | None) -> None:
        self.number = len(list(runs.glob("*/journal.sqlite"))[:first])

    def to_json(self) -> dict[str, int]:
        return {"runs": self.number}


CAMPAIGNS = Campaigns(
    first="temperatures",
    histories=(
        History(name="temperature", title="Temperatures", about="Number of runs.", read=Count, view=lambda: print),
    ),
)
