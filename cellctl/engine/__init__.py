"""The engine: runs a procedure once, step by step, cleans up, keeps the journal."""

from cellctl.engine.context import Context, Surround
from cellctl.engine.mailbox import Action, ActionName, Mailbox, Operator
from cellctl.engine.mailbox_folder import MailboxFolder
from cellctl.engine.outcome import Outcome
from cellctl.engine.runner import Aborted, Engine, Plan
from cellctl.engine.states import ENDS, TRANSITIONS, IllegalTransition, State
from cellctl.engine.watcher import NobodyWatching, Watcher

__all__ = [
    "ENDS",
    "TRANSITIONS",
    "Aborted",
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
    "Plan",
    "State",
    "Surround",
    "Watcher",
]
