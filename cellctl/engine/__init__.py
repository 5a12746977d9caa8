"""The engine runs a procedure once, step by step, cleans up and writes the journal."""

from cellctl.engine._context import Context, Plan, Surround
from cellctl.engine._mailbox import Action, ActionName, Mailbox, MailboxFolder, Operator
from cellctl.engine._recorder import NobodyWatching, Watcher
from cellctl.engine._runner import Engine
from cellctl.engine._states import ENDS, TRANSITIONS, Aborted, AbortedByInterlock, IllegalTransition, Outcome, State
from cellctl.engine.status import Passes

__all__ = [
    "ENDS",
    "TRANSITIONS",
    "Aborted",
    "AbortedByInterlock",
    "Action",
    "ActionName",
    "Context",
    "Engine",
    "IllegalTransition",
    "Mailbox",
    "MailboxFolder",
    "NobodyWatching",
    "Operator",
    "Outcome",
    "Passes",
    "Plan",
    "State",
    "Surround",
    "Watcher",
]
