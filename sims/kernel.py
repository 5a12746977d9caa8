"""The cell's time: one queue of events, and the files on which hosts answer, in one thread."""

from __future__ import annotations

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


BUSY_NS = 60_000_000_000
"""How long a peer that reported that it computes may be silent, of wall time; its end closes its line at once."""
PATIENCE_NS = 10_000_000_000
"""Wall time after which a peer that does not answer is taken for dead. One that ends hangs up and is not waited for."""

FOR_EVER_NS = 1 << 62
"""Wall time of a hold that only `release` ends."""

QUIET_NS = 1_000_000_000
"""Wall time without a word from anybody after which T runs no faster than the wall, as beside a dead peer."""

_CHORES_NS = 500_000_000
_STALL_NS = 1_000_000_000
"""Wall time by which a turn is late when this process, or the whole computer, stood still."""


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
    """T is stopped until `release`, or until `deadline_ns` of wall time. An inert hold (a dead peer's) has no effect.

    Events that are due before `from_ns` do not wait for it.
    """

    __slots__ = ("_held", "deadline_ns", "from_ns", "peer")

    def __init__(self, peer: str, deadline_ns: int, from_ns: int, held: dict[Hold, None] | None) -> None:
        self.peer = peer
        self.deadline_ns = deadline_ns
        self.from_ns = from_ns
        self._held = held
        if held is not None:
            held[self] = None

    @property
    def active(self) -> bool:
        """Whether this hold stops T."""
        return self._held is not None

    def extend(self) -> None:
        """The peer reports that it is at work: on a busy machine it may then be silent for up to `BUSY_NS`."""
        self.deadline_ns = time.monotonic_ns() + BUSY_NS

    def release(self) -> None:
        """The awaited answer arrived. A second call has no effect."""
        held, self._held = self._held, None
        if held is not None:
            held.pop(self, None)


@final
class Kernel:
    """The owner of the cell's time T, an integer in nanoseconds from 0 at the start.

    lockstep: T advances from event to event and is stopped while a hold is active. realtime: T is CLOCK_MONOTONIC minus
    `epoch_ns`; files are read before events that are due, an event sees the T it was due at, a file callback the T of
    the wall or of the next event, whichever is earlier. T never goes back.
    `publish` is called with each new T before anything happens at it (lockstep). `before_event` is called in lockstep
    whenever nothing holds T and an event may be next; it may hold T.
    """

    def __init__(self, mode: Mode, publish: Callable[[int], object] | None = None) -> None:
        self.mode = mode
        self.now = 0
        self.epoch_ns = time.monotonic_ns()
        self.events_run = 0
        self.before_event: Action = lambda: None
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

    def hold(self, peer: str, patience_ns: int | None = None) -> Hold:
        """Stop T until `peer` has answered, or has been silent for `patience_ns` (10 s) of wall time.

        After such a silence the peer's later holds are inert until `alive(peer)`. In real time it is inert.
        """
        if self.mode == "realtime" or peer in self._dead:
            return Hold(peer, 0, 0, None)
        return Hold(peer, time.monotonic_ns() + (patience_ns or PATIENCE_NS), 0, self._held)

    def hold_for_answer(self, peer: str, within_ns: int) -> Hold:
        """As `hold`; in real time, events due `within_ns` from now or later wait as long on the wall for the answer.

        That is no delay, unless this process was itself kept waiting: its own stall is not the peer's fault.
        """
        if self.mode == "lockstep":
            return self.hold(peer)
        return Hold(peer, time.monotonic_ns() + within_ns, self.now + within_ns, self._held)

    def alive(self, peer: str) -> None:
        """`peer` was heard: T waits for it again."""
        self._dead.discard(peer)

    def is_dead(self, peer: str) -> bool:
        """Whether T runs on without `peer`."""
        return peer in self._dead

    def forget(self, peer: str) -> None:
        """`peer` has disconnected: T no longer waits for it; a new connection starts from the beginning."""
        self._release_all(peer)
        self._dead.discard(peer)

    def holders(self) -> list[str]:
        """The peers for which T is stopped now."""
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
        turn = self._lockstep_turn if self.mode == "lockstep" else self._realtime_turn
        while self._running:
            turn()

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
        wait_ns, begun = self._lockstep_wait_ns(), time.monotonic_ns()
        heard = self._serve(wait_ns)
        self._excuse(time.monotonic_ns() - begun - wait_ns)
        if not self._held:
            self.before_event()
        if not self._held:
            self._drop_cancelled()
            self._next_event()
        else:
            # with answers just in, the one awaited may be the next: this process may itself have been stopped
            self._give_up(time.monotonic_ns() - (PATIENCE_NS if heard else 0))

    def _lockstep_wait_ns(self) -> int:
        """Wall time to wait for the hosts before T may go on; 0 where it may go on now."""
        wall = time.monotonic_ns()
        until = self._first_deadline() if self._held else self._next_due_wall(wall)
        return max(0, min(until, self._chores_at) - wall)

    def _first_deadline(self) -> int:
        return min(hold.deadline_ns for hold in self._held)

    def _next_due_wall(self, wall: int) -> int:
        if not self._queue:
            return self._chores_at
        if not self._dead and wall - self._heard_at < QUIET_NS:
            return wall
        # no peer, or one may return: let T run as on a real cell
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

    def _excuse(self, late_ns: int) -> None:
        """Extend every peer's time by that of a stall: a computer that stands still for 10 s makes nobody dead."""
        if late_ns > _STALL_NS:
            for hold in self._held:
                hold.deadline_ns += late_ns

    def _release_all(self, peer: str) -> None:
        for hold in [hold for hold in self._held if hold.peer == peer]:
            hold.release()

    def _realtime_turn(self) -> None:
        self._do_chores(time.monotonic_ns())
        self._drop_cancelled()
        self._serve(self._realtime_wait_ns())
        self._run_due()

    def _realtime_wait_ns(self) -> int:
        """Wall time until the next event is due; for one that waits for an answer, until that is overdue."""
        wall = time.monotonic_ns()
        until = self._chores_at
        if self._queue:
            due = self._queue[0][0]
            deadlines = [hold.deadline_ns for hold in self._held if hold.from_ns <= due]
            until = min(until, max(self.epoch_ns + due, min(deadlines, default=0)))
        return max(0, until - wall)

    def _run_due(self) -> None:
        """One event, where one is due. Before the next, files are read again."""
        wall = time.monotonic_ns()
        for hold in [hold for hold in self._held if hold.deadline_ns <= wall]:
            hold.release()
        if not self._running or not self._queue:
            return
        due = self._queue[0][0]
        if due > wall - self.epoch_ns or any(hold.from_ns <= due for hold in self._held):
            return
        _, _, event = heapq.heappop(self._queue)
        self.now = max(self.now, due)
        self.events_run += 1
        event.run()

    def _serve(self, wait_ns: int) -> bool:
        """Wait for files to read, and serve those that can be. True where somebody was heard."""
        ready = self._selector.select(wait_ns * 1e-9)
        if not ready:
            return False
        if self.mode == "realtime":
            wall = time.monotonic_ns() - self.epoch_ns
            self.now = max(self.now, min(wall, self._queue[0][0]) if self._queue else wall)
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
        for chore in self._chores:
            chore()

    def _drain_wake(self) -> None:
        with suppress(BlockingIOError):
            os.read(self._wake_read, 64)
