"""The procedure of a run as a tree of immutable nodes, as pages and programs show it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import final

from cellctl.procedure import Action, Confirm, If, Loop, step_path


class NodeKind(StrEnum):
    """What a node stands for: an action of the procedure, a pass of a loop, or a list of actions."""

    PROCEDURE = "procedure"
    STEP = "step"
    LOOP = "loop"
    PASS = "pass"
    IF = "if"
    CONFIRM = "confirm"
    CLEANUP = "cleanup"


class NodeState(StrEnum):
    """State of a node. `interrupted`: cancelled, or its process ended first; `skipped`: a branch not taken."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    INTERRUPTED = "interrupted"
    SKIPPED = "skipped"


@final
@dataclass(frozen=True, slots=True)
class Node:
    """A node of the tree.

    `path`: as in the journal; `points[]` stands for any pass of a loop. `attempts`: begun ones, so it was retried
    `attempts` − 1 times. `current`: the step in progress or the next one, and all nodes around it. `done` of `total`:
    passes of a loop, else steps; `total` None: not known yet. `failure`: of the latest attempt. `line`: in the
    procedure file, from 1. `children`: of a loop its begun passes, or its steps while none has begun.
    """

    path: str
    kind: NodeKind
    title: str
    state: NodeState = NodeState.WAITING
    attempts: int = 0
    current: bool = False
    done: int = 0
    total: int | None = 1
    failure: str = ""
    line: int = 0
    children: tuple[Node, ...] = ()

    @property
    def retried(self) -> int:
        """How often it was tried again."""
        return max(0, self.attempts - 1)


KINDS: Mapping[type, NodeKind] = {Loop: NodeKind.LOOP, If: NodeKind.IF, Confirm: NodeKind.CONFIRM}
"""Kind of the node of an action; a step's is STEP."""


def outline(
    actions: tuple[Action, ...], titles: Mapping[str, str], outer: str, state: NodeState = NodeState.WAITING
) -> tuple[Node, ...]:
    """Nodes of `actions` inside `outer` that have not begun. `titles`: action id → title."""
    found = []
    for action in actions:
        path, children = step_path(outer, action.id), tuple[Node, ...]()
        if isinstance(action, Loop):
            children = outline(action.steps, titles, f"{path}[]", state)
        elif isinstance(action, If):
            children = outline((*action.then, *action.otherwise), titles, path, state)
        kind, total = KINDS.get(type(action), NodeKind.STEP), None if isinstance(action, Loop) else 1
        found.append(Node(path, kind, titles[action.id], state, total=total, line=action.line, children=children))
    return tuple(found)
