"""The index of runs: what lists, searches, histories and trends need of each run, beside the journals.

The journals stay the only record: all of it can be made from them again.
"""

from cellctl.run_index._content import HistoryEntry, IndexedParameter, IndexedRun
from cellctl.run_index._opening import FILE_NAME, VARIABLE, opened_index, remove_damaged, shared_url
from cellctl.run_index._queries import FoundRun, RunFilter, Series
from cellctl.run_index._scanner import Changes, Scanner, fingerprint
from cellctl.run_index._store import VANISHED, IndexUnusable, RunIndex

__all__ = [
    "FILE_NAME",
    "VANISHED",
    "VARIABLE",
    "Changes",
    "FoundRun",
    "HistoryEntry",
    "IndexUnusable",
    "IndexedParameter",
    "IndexedRun",
    "RunFilter",
    "RunIndex",
    "Scanner",
    "Series",
    "fingerprint",
    "opened_index",
    "remove_damaged",
    "shared_url",
]
