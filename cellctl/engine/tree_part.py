"""A part of the tree of a run's steps: counts what is done inside it, and freezes again only what changed."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Iterator, Mapping
from typing import Any, final

from cellctl.engine.tree_node import KINDS, Node, NodeKind, NodeState, outline
from cellctl.journal import Outcome, StepState
from cellctl.procedure import Action, If, Loop, step_path

_STATES = {
    Outcome.DONE: NodeState.DONE,
    Outcome.FAILED: NodeState.FAILED,
    Outcome.TIMED_OUT: NodeState.FAILED,
    Outcome.CANCELLED: NodeState.INTERRUPTED,
    Outcome.INTERRUPTED: NodeState.INTERRUPTED,
}
_OPEN = (NodeState.RUNNING, NodeState.INTERRUPTED)

Scope = ChainMap[str, Any]
"""Values by name: parameters, variables of the loops around, results of finished steps."""

Share = tuple[int, int, int, int]
"""Steps: done, in all, begun, failed at the latest attempt."""


@final
class Part:
    """An action, a pass or a list of actions, with its place in the tree. `step`: its latest attempt, if it has any.

    `done`, `total`, `begun`, `failed`: of its steps, those inside included. `values`: of a loop, None until known.
    `entered`: the run has reached this loop. `counted`: its passes count in the progress of the run; they do not where
    the run has reached a loop inside it (`inner_entered`).
    """

    __slots__ = (
        "_dirty",
        "_first",
        "_shown",
        "action",
        "begun",
        "children",
        "counted",
        "current",
        "dependent_loops",
        "done",
        "entered",
        "failed",
        "inner_entered",
        "kind",
        "outer",
        "passes_done",
        "path",
        "place",
        "scope",
        "step",
        "title",
        "total",
        "values",
    )

    def __init__(
        self,
        kind: NodeKind,
        path: str,
        title: str,
        scope: Scope,
        outer: Part | None = None,
        action: Action | None = None,
    ) -> None:
        self.kind, self.path, self.title, self.scope, self.outer, self.action = kind, path, title, scope, outer, action
        self.place = len(outer.children) if outer else 0
        self.children: list[Part] = []
        self.dependent_loops: dict[str, list[Part]] = {}
        self.step: StepState | None = None
        self.values: list[Any] | None = None
        self.done = self.total = self.begun = self.failed = self.passes_done = self._first = 0
        self.counted = self.entered = self.inner_entered = self.current = False
        self._dirty: set[int] = set()
        self._shown: list[Node] = []

    def child(self, action: Action, title: str) -> Part:
        """A new part for `action`, last in this list of actions."""
        scope = self.scope.new_child() if isinstance(action, If) else self.scope
        path, kind = step_path(self.path, action.id), KINDS.get(type(action), NodeKind.STEP)
        return self._appended(Part(kind, path, title, scope, self, action))

    def child_pass(self, variables: Mapping[str, Any]) -> Part:
        """A new part for the next pass of this loop."""
        index = len(self.children)
        scope = self.scope.new_child(dict(variables))
        return self._appended(Part(NodeKind.PASS, f"{self.path}[{index}]", str(index + 1), scope, self))

    def around(self) -> Iterator[Part]:
        """All parts around this one, the innermost first."""
        part = self.outer
        while part is not None:
            yield part
            part = part.outer

    def leaves(self) -> Iterator[Part]:
        """All parts inside this one that have attempts of their own."""
        for each in self.children:
            if each.kind not in (NodeKind.LOOP, NodeKind.PASS):
                yield each
            yield from each.leaves()

    def holds(self, name: str) -> bool:
        """Whether this list of actions has one with the id `name` so far."""
        return any(each.action is not None and each.action.id == name for each in self.children)

    def own(self) -> Share:
        """What this part itself adds to the counts, without the parts inside it."""
        done = self.step is not None and self.step.outcome is Outcome.DONE
        failed = self.step is not None and _STATES.get(self.step.outcome or Outcome.DONE) is NodeState.FAILED
        return int(done), 1, int(self.step is not None), int(failed)

    def add(self, change: Share) -> None:
        """Add to the counts."""
        self.done += change[0]
        self.total += change[1]
        self.begun += change[2]
        self.failed += change[3]

    @property
    def complete(self) -> bool:
        """Whether it has steps, and all of them are done."""
        return 0 < self.done == self.total

    @property
    def in_progress(self) -> bool:
        """Whether its own attempt is in progress."""
        return self.step is not None and self.step.outcome is None

    def first_open(self) -> Part | None:
        """The first part inside it with a step that is not done."""
        while self._first < len(self.children):
            each = self.children[self._first]
            if each.done < each.total:
                return each
            self._first += 1
        return None

    def reopen(self) -> None:
        """It may be the first open part again, also for the parts around it."""
        part = self
        for outer in self.around():
            outer._first = min(outer._first, part.place)
            part = outer

    def clear(self) -> None:
        """Remove all parts inside it."""
        self.children, self._shown, self._dirty, self._first = [], [], set(), 0

    def touch(self) -> None:
        """It has changed: it and the parts around it are frozen again."""
        part = self
        for outer in self.around():
            outer._dirty.add(part.place)
            part = outer

    def touch_open(self) -> None:
        """Whether a process executes the run has changed: freeze again all whose state depends on it."""
        for index, node in enumerate(self._shown):
            if node.state in _OPEN:
                self._dirty.add(index)
                self.children[index].touch_open()

    def frozen(self, titles: Mapping[str, str], alive: bool) -> Node:
        """Its node now. `titles`: action id → title; `alive`: a process executes the run."""
        for index in sorted(self._dirty):
            part = self.children[index]
            if part.kind is NodeKind.PASS and not part.begun:
                continue
            while len(self._shown) <= index:
                self._shown.append(self.children[len(self._shown)].frozen(titles, alive))
            self._shown[index] = part.frozen(titles, alive)
        self._dirty.clear()
        is_loop = self.kind is NodeKind.LOOP
        return Node(
            self.path,
            self.kind,
            self.title,
            self._state(alive),
            self.step.attempt if self.step else 0,
            self.current,
            self.passes_done if is_loop else self.done,
            (None if self.values is None else len(self.values)) if is_loop else self.total,
            self.step.failure.text if self.step and self.step.failure else "",
            self.action.line if self.action else 0,
            (*self._shown, *self._not_begun(titles)),
        )

    def _state(self, alive: bool) -> NodeState:
        under_way = NodeState.RUNNING if alive else NodeState.INTERRUPTED
        if self.values == []:
            return NodeState.SKIPPED
        if not self.begun:
            return NodeState.WAITING
        if self.step is not None and not (self.kind is NodeKind.IF and self.step.outcome is Outcome.DONE):
            return under_way if self.step.outcome is None else _STATES[self.step.outcome]
        if self.complete and (self.values is None or self.passes_done == len(self.values)):
            return NodeState.DONE
        return NodeState.FAILED if self.failed else under_way

    def _not_begun(self, titles: Mapping[str, str]) -> tuple[Node, ...]:
        """The steps of a loop with no begun pass; both branches of an undecided `if`; then the one not taken."""
        match self.action:
            case Loop(steps=steps) if not self._shown:
                return outline(steps, titles, f"{self.path}[]")
            case If(then=then, otherwise=otherwise) if self.step and self.step.outcome is Outcome.DONE:
                other = otherwise if self.step.result["value"] else then
                return outline(other, titles, self.path, NodeState.SKIPPED)
            case If(then=then, otherwise=otherwise):
                return outline((*then, *otherwise), titles, self.path)
            case _:
                return ()

    def _appended(self, part: Part) -> Part:
        self.children.append(part)
        self._dirty.add(part.place)
        return part
