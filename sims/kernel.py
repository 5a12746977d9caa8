"""The cell's time: one queue of events, and the files on which hosts answer, in one thread."""

from __future__ import annotations

import gc
import heapq
import itertools
import os
import selectors
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Literal, Protocol, final

Action = Callable[[], object]
Mode = Literal["lockstep", "realtime"]


class HasFileno(Protocol):
    """A socket, or another file that the operating system can wait for."""

    def fileno(self) -> int:
        """Its descriptor."""


File = int | HasFileno


PATIENCE_NS = 10_000_000_000
"""Wall time after which a peer that does not answer is taken for dead. One that ends hangs up and is not waited for."""

QUIET_NS = 1_000_000_000
"""Wall time without a word from anybody after which T runs no faster than the wall, as beside a dead peer."""

_CHORES_NS = 500_000_000


@final
class Event:
    """An action to come; `cancel` takes it back, also while the actions of the same instant run."""

    __slots__ = ("_action",)

    def __init__(self, action: Action) -> None:
        self._action: Action | None = action

    @property
    def pending(self) -> bool:
        """Whether the action is still to come."""
        return self._action is not None

    def cancel(self) -> None:
        """Take the action back; nothing happens where it has run."""
        self._action = None

    def run(self) -> None:
        """Do it, once. The kernel calls this when its time has come."""
        action, self._action = self._action, None
        if action is not None:
            action()


@final
class Hold:
    """T stands still until `release`. An inert hold (real time, or a dead peer) holds nothing."""

    __slots__ = ("_held", "deadline_ns", "peer")

    def __init__(self, peer: str, deadline_ns: int, held: dict[Hold, None] | None) -> None:
        self.peer = peer
        self.deadline_ns = deadline_ns
        self._held = held
        if held is not None:
            held[self] = None

    @property
    def active(self) -> bool:
        """Whether T stands still because of this hold."""
        return self._held is not None

    def release(self) -> None:
        """The awaited answer is there. Twice is once."""
        held, self._held = self._held, None
        if held is not None:
            held.pop(self, None)


@final
class Kernel:
    """The owner of the cell's time T, an integer in nanoseconds from 0 at the start.

    lockstep: T leaps from event to event and stands still while a hold is active. realtime: T is CLOCK_MONOTONIC minus
    `epoch_ns`; an event sees the T it was due at, a file callback the T of the wall. T never goes back.
    `publish` is called with each new T before anything happens at it (lockstep).
    """

    def __init__(self, mode: Mode, publish: Callable[[int], object] | None = None) -> None:
        self.mode = mode
        self.now = 0
        self.epoch_ns = time.monotonic_ns()
        self.events_run = 0
        self._publish = publish or (lambda now: None)
        self._queue: list[tuple[int, int, Event]] = []
        self._order = itertools.count()
        self._held: dict[Hold, None] = {}
        self._dead: set[str] = set()
        self._chores: list[Action] = []
        self._chores_at = self.epoch_ns + _CHORES_NS
        self._heard_at = self.epoch_ns - QUIET_NS
        self._moved_at = self.epoch_ns
        self._running = True
        # epoll rounds time-outs up to milliseconds, which is a quarter of an interpolation cycle; select does not
        self._selector = selectors.DefaultSelector() if mode == "lockstep" else selectors.SelectSelector()
        self._wake_read, self._wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._callbacks: dict[int, Action] = {}
        self.watch(self._wake_read, self._drain_wake)
        self._publish(0)

    def at(self, time_ns: int, action: Action) -> Event:
        """Do `action` when T is `time_ns`, or at once where that is past; in the order asked among equal times."""
        event = Event(action)
        heapq.heappush(self._queue, (max(time_ns, self.now), next(self._order), event))
        return event

    def after(self, delay_ns: int, action: Action) -> Event:
        """Do `action` once `delay_ns` have passed."""
        return self.at(self.now + delay_ns, action)

    def hold(self, peer: str) -> Hold:
        """Let T stand still until `peer` has answered, or has been silent for ten seconds of wall time.

        After such a silence the peer's later holds are inert until `alive(peer)`.
        """
        if self.mode == "realtime" or peer in self._dead:
            return Hold(peer, 0, None)
        return Hold(peer, time.monotonic_ns() + PATIENCE_NS, self._held)

    def alive(self, peer: str) -> None:
        """`peer` was heard: T waits for it again."""
        self._dead.discard(peer)

    def is_dead(self, peer: str) -> bool:
        """Whether T runs on without `peer`."""
        return peer in self._dead

    def forget(self, peer: str) -> None:
        """`peer` has hung up: nothing waits for it any more, and it starts afresh when it calls again."""
        self._release_all(peer)
        self._dead.discard(peer)

    def holders(self) -> list[str]:
        """The peers for whom T stands still now."""
        return sorted({hold.peer for hold in self._held})

    def watch(self, file: File, on_readable: Action) -> None:
        """Call `on_readable` whenever `file` can be read without blocking."""
        self._callbacks[self._selector.register(file, selectors.EVENT_READ).fd] = on_readable

    def unwatch(self, file: File) -> None:
        """Stop watching `file`; nothing happens where it was not watched."""
        with suppress(KeyError, ValueError):
            self._callbacks.pop(self._selector.unregister(file).fd)

    def every_half_second(self, chore: Action) -> None:
        """Do `chore` about every half second of wall time, whether T moves or not."""
        self._chores.append(chore)

    def run(self) -> None:
        """Run until `stop`. What an action raises ends the run."""
        gc.collect()
        gc.freeze()
        gc.disable()
        turn = self._lockstep_turn if self.mode == "lockstep" else self._realtime_turn
        try:
            while self._running:
                turn()
        finally:
            gc.enable()
            gc.unfreeze()

    def stop(self) -> None:
        """End `run` after the present action. Safe from any thread and from a signal handler."""
        self._running = False
        with suppress(OSError):
            os.write(self._wake_write, b"!")

    def close(self) -> None:
        """Let go of the selector. The watched files stay open."""
        self._selector.close()
        os.close(self._wake_read)
        os.close(self._wake_write)

    def _lockstep_turn(self) -> None:
        self._do_chores(time.monotonic_ns())
        self._drop_cancelled()
        heard = self._serve(self._lockstep_wait_ns())
        if not self._held:
            self._next_event()
        else:
            # with answers just in, the one awaited may be the next: this process may itself have been stopped
            self._give_up(time.monotonic_ns() - (PATIENCE_NS if heard else 0))

    def _lockstep_wait_ns(self) -> int:
        """Wall time to wait for the hosts before T may go on; 0 where it may go on now."""
        wall = time.monotonic_ns()
        until = next(iter(self._held)).deadline_ns if self._held else self._next_due_wall(wall)
        return max(0, min(until, self._chores_at) - wall)

    def _next_due_wall(self, wall: int) -> int:
        if not self._queue:
            return self._chores_at
        if not self._dead and wall - self._heard_at < QUIET_NS:
            return wall
        # nobody would notice a leap, or somebody may come back: let T go as it would on a real cell
        return self._moved_at + self._queue[0][0] - self.now

    def _next_event(self) -> None:
        wall = time.monotonic_ns()
        if not self._running or not self._queue or wall < self._next_due_wall(wall):
            return
        due, _, event = heapq.heappop(self._queue)
        if due != self.now:
            self._moved_at = wall
            self.now = due
            self._publish(due)
        self.events_run += 1
        event.run()

    def _drop_cancelled(self) -> None:
        while self._queue and not self._queue[0][2].pending:
            heapq.heappop(self._queue)

    def _give_up(self, wall: int) -> None:
        for hold in [hold for hold in self._held if hold.deadline_ns <= wall]:
            self._dead.add(hold.peer)
            self._release_all(hold.peer)

    def _release_all(self, peer: str) -> None:
        for hold in [hold for hold in self._held if hold.peer == peer]:
            hold.release()

    def _realtime_turn(self) -> None:
        self._do_chores(time.monotonic_ns())
        self._run_due()
        due = self.epoch_ns + self._queue[0][0] if self._queue else self._chores_at
        self._serve(max(0, min(due, self._chores_at) - time.monotonic_ns()))

    def _run_due(self) -> None:
        wall = time.monotonic_ns() - self.epoch_ns
        while self._running and self._queue and self._queue[0][0] <= wall:
            due, _, event = heapq.heappop(self._queue)
            self.now = max(self.now, due)
            self.events_run += 1
            event.run()
        self.now = max(self.now, wall)

    def _serve(self, wait_ns: int) -> bool:
        """Wait for files to read, and serve those that can be. True where somebody was heard."""
        ready = self._selector.select(wait_ns * 1e-9)
        if not ready:
            return False
        if self.mode == "realtime":
            self._run_due()
        self._heard_at = time.monotonic_ns()
        for key, _ in ready:
            callback = self._callbacks.get(key.fd)
            if callback is not None:  # not unwatched by the one before
                callback()
        return True

    def _do_chores(self, wall: int) -> None:
        if wall < self._chores_at:
            return
        self._chores_at = wall + _CHORES_NS
        gc.collect()
        for chore in self._chores:
            chore()

    def _drain_wake(self) -> None:
        with suppress(BlockingIOError):
            os.read(self._wake_read, 64)
