"""The tree of a run's steps, updated event by event; an event costs as much as its step is deep."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast, final

from cellctl.engine.tree_node import Node, NodeKind
from cellctl.engine.tree_part import Part, Share
from cellctl.journal import Outcome, StepState
from cellctl.procedure import Action, If, Loop, Procedure, UnresolvedReference, resolve, walk
from cellctl.procedure.references import references_in


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
