"""The engine runs a procedure once, step by step, cleans up and writes the journal."""

from cellctl.engine.context import Context, Surround
from cellctl.engine.mailbox import Action, ActionName, Mailbox, Operator
from cellctl.engine.mailbox_folder import MailboxFolder
from cellctl.engine.outcome import Aborted, AbortedByInterlock, Outcome
from cellctl.engine.passes import Passes
from cellctl.engine.plan import Plan
from cellctl.engine.runner import Engine
from cellctl.engine.states import ENDS, TRANSITIONS, IllegalTransition, State
from cellctl.engine.watcher import NobodyWatching, Watcher

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
