"""The tree of a run's steps, updated event by event; an event costs as much as its step is deep."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, cast, final

from cellctl.journal import Outcome, StepState
from cellctl.procedure import Action, Confirm, If, Loop, Procedure, UnresolvedReference, resolve, step_path, walk
from cellctl.procedure.references import references_in


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


@final
class StepTree:
    """The steps of a run as far as the lists of its loops are known. `passes`: as `Passes`, done and in all.

    `titles`: action id → title. `parameters`: of the run. `states`: the latest attempt of each step, by path; the
    owner changes it and then calls `changed`.
    """

    def __init__(
        self,
        procedure: Procedure,
        titles: Mapping[str, str],
        parameters: Mapping[str, Any],
        states: Mapping[str, StepState],
    ) -> None:
        self.passes_done = self.passes_total = 0
        self._titles, self._states = titles, states
        self._leaves: dict[str, Part] = {}
        self._loops: dict[str, Part] = {}
        self._alive = False
        self._current: list[Part] = []
        self._steps = Part(NodeKind.PROCEDURE, "", procedure.title, ChainMap(dict(parameters)))
        self._cleanup = Part(NodeKind.CLEANUP, "cleanup", "Clean-up", ChainMap(dict(parameters)))
        self._add(self._steps, procedure.steps)
        self._add(self._cleanup, procedure.cleanup)

    @property
    def done(self) -> int:
        """Finished steps, without clean-up."""
        return self._steps.done

    @property
    def total(self) -> int:
        """Steps known so far, without clean-up."""
        return self._steps.total

    def passes_left(self) -> dict[str, int]:
        """The passes to come of each loop whose passes count, by its path."""
        counted = (part for part in self._loops.values() if part.counted and part.values is not None)
        return {part.path: len(part.values or ()) - part.passes_done for part in counted}

    def changed(self, path: str) -> None:
        """The latest attempt of the step at `path` has changed. A step of a loop not known yet is placed later."""
        around, _, rest = path.rpartition("[")
        loop = self._loops.get(around)
        if loop is not None and path not in self._leaves:
            self._make_passes(loop, int(rest.partition("]")[0]) + 1)
            return
        part = self._leaves.get(path)
        if part is not None:
            self._place(part, self._states[path])

    def reach(self) -> Part | None:
        """The first step that is not done; each loop around it has begun. None: all known steps are done."""
        part, found = self._steps.first_open(), None
        while part is not None:
            if part.kind is NodeKind.LOOP:
                self._begin(part)
                if part.first_open() is None:
                    self._make_passes(part, len(part.children) + 1)
            part, found = part.first_open(), part
        return found

    def frozen(self, *, alive: bool, cleaning: bool) -> Node:
        """The whole tree. `alive`: a process executes the run; `cleaning`: its steps are over."""
        if alive != self._alive:
            self._alive = alive
            self._steps.touch_open()
            self._cleanup.touch_open()
        self._mark_current(self._position(cleaning=cleaning) if alive else None)
        steps, cleanup = (root.frozen(self._titles, alive) for root in (self._steps, self._cleanup))
        return replace(steps, children=(*steps.children, cleanup)) if cleanup.children else steps

    def _position(self, *, cleaning: bool) -> Part | None:
        at_cleanup = next((each for each in self._cleanup.children if each.in_progress), None)
        return at_cleanup or (None if cleaning else self.reach())

    def _mark_current(self, part: Part | None) -> None:
        found = [part, *part.around()] if part else []
        for each in {*found} ^ {*self._current}:
            each.current = not each.current
            each.touch()
        self._current = found

    def _add(self, block: Part, actions: tuple[Action, ...]) -> None:
        """Add `actions` to `block`, with what is known of them."""
        for action in actions:
            part = block.child(action, self._titles[action.id])
            if isinstance(action, Loop):
                for _, reference in references_in(action.for_each):
                    owner = next((each for each in part.around() if each.holds(reference.name)), block)
                    owner.dependent_loops.setdefault(reference.name, []).append(part)
                self._expand(part, action)
                continue
            self._leaves[part.path] = part
            self._count(part, (0, 1, 0, 0))
            if part.path in self._states:
                self._place(part, self._states[part.path])

    def _place(self, part: Part, step: StepState) -> None:
        """Note the latest attempt of a step, and all that is known by its result."""
        before = part.own()
        part.step = step
        done, total, begun, failed = part.own()
        self._count(part, (done - before[0], total - before[1], begun - before[2], failed - before[3]))
        part.reopen()
        if step.outcome is not Outcome.DONE or part.outer is None or part.action is None:
            return
        part.outer.scope[part.action.id] = step.result
        if isinstance(part.action, If) and not part.children:
            self._add(part, part.action.then if step.result["value"] else part.action.otherwise)
        for loop in part.outer.dependent_loops.get(part.action.id, ()):
            assert isinstance(loop.action, Loop)
            self._expand(loop, loop.action)

    def _expand(self, part: Part, loop: Loop) -> None:
        """Add the passes of `loop`, if its list is known; anew, if the list has changed."""
        try:
            values = resolve(loop.for_each, part.scope)
        except UnresolvedReference:  # the step that returns the list is not done yet
            return
        if values == part.values:
            return
        again = part.values is not None
        self._remove_passes(part)
        part.values, self._loops[part.path] = values, part
        nested = any(isinstance(each, Loop) for each in walk(loop.steps))
        self._count(part, (0, len(values) * len(loop.steps), 0, 0))
        self._make_passes(part, len(values) if again or nested else 0)

    def _make_passes(self, part: Part, number: int) -> None:
        """Add the first `number` passes of a loop, if they are missing: an unmade pass is counted only."""
        assert isinstance(part.action, Loop)
        for value in (part.values or [])[len(part.children) : number]:
            self._count(part, (0, -len(part.action.steps), 0, 0))
            self._add(part.child_pass({part.action.variable: value}), part.action.steps)

    def _remove_passes(self, part: Part) -> None:
        for leaf in part.leaves():
            del self._leaves[leaf.path]
            done, total, begun, failed = leaf.own()
            self._count(leaf, (-done, -total, -begun, -failed))
        if part.values:
            unmade = len(part.values) - len(part.children)
            self._count(part, (0, -unmade * len(cast("Loop", part.action).steps), 0, 0))
        self._uncount(part)
        part.entered = False
        part.clear()

    def _count(self, part: Part, change: Share) -> None:
        """Add `change` to the counts of `part` and of everything around it."""
        part.add(change)
        for each in part.around():
            was = each.complete
            each.add(change)
            if each.kind is NodeKind.PASS and each.complete is not was and each.outer:
                self._pass_ended(each.outer, 1 if each.complete else -1)
        part.touch()

    def _pass_ended(self, loop: Part, change: int) -> None:
        self._begin(loop)
        loop.passes_done += change
        if loop.counted:
            self.passes_done += change

    def _begin(self, loop: Part) -> None:
        """The passes of `loop` count from now on, in place of those of the loops around it."""
        if loop.entered:
            return
        loop.entered = True
        for each in loop.around():
            if each.kind is NodeKind.LOOP:
                each.inner_entered = True
                self._uncount(each)
        if not loop.inner_entered:
            loop.counted = True
            self.passes_done += loop.passes_done
            self.passes_total += len(loop.values or ())

    def _uncount(self, loop: Part) -> None:
        if loop.counted:
            loop.counted = False
            self.passes_done -= loop.passes_done
            self.passes_total -= len(loop.values or ())
