"""The program CELLCTL_KVP on the controller, and the controller's own state: message, flags, timers, motion."""

from __future__ import annotations

from typing import final

from sims.faults import Faults
from sims.kernel import Event, Kernel
from sims.memory import Memory
from sims.scene.scene import Scene
from sims.varproxy._proxy import JOB
from sims.varproxy._variables import DataList

CYCLE_NS = 12_000_000
MS = 1_000_000
FLAG, TIMER = 413, 20

DONE, NOT_READY, OUTSIDE_LIMIT, BAD_SPEED, BAD_CHECK, STOPPED, NO_SUCH_ROW = 0, 12, 20, 21, 22, 30, 42

MOST_PERCENT = 100

EMERGENCY_STOP = "KSS00001 EMERGENCY STOP"
GUARD_OPEN = "KSS00207 Operator safety / safety fence open"
NO_ENABLE = "KSS00203 General motion enable"
COLLISION = "KSS00117 Collision detection: the tool has struck an obstacle"


@final
class Timer:
    """`$TIMER[n]`: counts milliseconds while it is not stopped."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._value_ms, self._since_ns = 0, kernel.now
        self.stopped = True

    @property
    def value_ms(self) -> int:
        """What it shows now."""
        passed = 0 if self.stopped else (self._kernel.now - self._since_ns) // MS
        return self._value_ms + passed

    def set(self, value_ms: int) -> None:
        """Count on from here."""
        self._value_ms, self._since_ns = value_ms, self._kernel.now

    def stop(self, *, stopped: bool) -> None:
        """Stop it, or let it count."""
        self.set(self.value_ms)
        self.stopped = stopped


@final
class KvpProgram:
    """Takes a job when `KV_GO` has a new number; stops at the flag, when the timer reaches zero, and at a message.

    `message`: stands until it is acknowledged; then the program is started again, as somebody does it at the pendant.
    """

    def __init__(
        self,
        kernel: Kernel,
        scene: Scene,
        faults: Faults,
        memory: Memory,
        data: DataList,
        limits: tuple[tuple[float, float], ...],
    ) -> None:
        self.message = ""
        self.flags: set[int] = set()
        self.timers: dict[int, Timer] = {}
        self.limits = limits
        self._kernel, self._scene, self._arm, self._faults, self._memory = kernel, scene, scene.arm, faults, memory
        self._data = data
        self._job = 0
        self._braking = False
        self._silence: Event | None = None
        data.go.changed = self._given
        faults.on_start("varproxy.stop", lambda: self.fail(EMERGENCY_STOP))
        scene.safety.subscribe(self._safety_changed)
        scene.arm.on_collision = lambda: self.fail(COLLISION)

    @property
    def stands(self) -> bool:
        """`$ROB_STOPPED`."""
        return not self._job and not self._braking

    @property
    def beat(self) -> int:
        """`KV_BEAT`: counts in every round of its loop, but not during a job."""
        return self._kernel.now // CYCLE_NS % 1_000_000 if self.stands and not self.message else 0

    def timer(self, number: int) -> Timer:
        """A timer of the controller."""
        return self.timers.setdefault(number, Timer(self._kernel))

    def set_flag(self, number: int, *, on: bool) -> None:
        """`$FLAG[n]`; a rising stop flag stops the job."""
        (self.flags.add if on else self.flags.discard)(number)
        if number == FLAG and on:
            self._stop()

    def timer_changed(self) -> None:
        """The watch over the computer was set again: when it reaches zero, the job is stopped."""
        if self._silence:
            self._silence.cancel()
        timer = self.timer(TIMER)
        if not timer.stopped:
            self._silence = self._kernel.after(max(0, -timer.value_ms) * MS, self._stop)

    def fail(self, message: str) -> None:
        """The controller stops by itself and shows a message."""
        self.message = message
        self._brake()

    def acknowledge(self) -> bool:
        """Acknowledge, and start the program again; false where the cause is still there."""
        if self._scene.safety.ok and self.stands:
            self.message = ""
            self._data.done.values[()] = self._data.go.get()
        return not self.message

    def _given(self, _: tuple[int, ...] = ()) -> None:
        """A number was written: the loop sees it in its next round."""
        self._kernel.at((self._kernel.now // CYCLE_NS + 1) * CYCLE_NS, self._look)

    def _look(self) -> None:
        number = self._data.go.get()
        if self.message or not self.stands or number == self._data.done.get():
            return
        self._job = number
        outcome = self._judged(number)
        target = self._data.target()
        if outcome or target is None:
            self._end(outcome)
            return
        self._faults.announce(JOB)
        self._arm.move(target, self._data.job.get()["PERCENT"], lambda: self._end(DONE))

    def _judged(self, number: int) -> int:
        """0, or why the job is not done."""
        if not self._data.job_fits(number):
            return BAD_CHECK
        if not self._scene.safety.motion_enabled:
            return NOT_READY
        if not 1 <= self._data.job.get()["PERCENT"] <= MOST_PERCENT:
            return BAD_SPEED
        target = self._data.target()
        if target is None:
            return NO_SUCH_ROW
        if any(not low <= angle <= high for angle, (low, high) in zip(target, self.limits, strict=True)):
            return OUTSIDE_LIMIT
        timer = self.timer(TIMER)
        return STOPPED if FLAG in self.flags or timer.stopped or timer.value_ms >= 0 else DONE

    def _safety_changed(self) -> None:
        if not self._scene.safety.ok:
            self.fail(EMERGENCY_STOP if not self._scene.safety.emergency_stop_ok else GUARD_OPEN)
        elif not self._scene.safety.motion_enabled and self._job:
            self.fail(NO_ENABLE)

    def _stop(self) -> None:
        """The interrupt: brake, and give the job up."""
        if self._job and not self.message:
            self._brake()

    def _brake(self) -> None:
        if self._job and not self._braking:
            self._braking = True
            self._arm.brake(self._at_rest)

    def _at_rest(self) -> None:
        """The program goes on behind its job, unless a message holds it."""
        self._braking = False
        self._arm.take_measured()
        if self.message:
            self._job = 0
            self._memory.save()
        else:
            self._end(STOPPED)

    def _end(self, outcome: int) -> None:
        self._memory.save()
        self._data.outcome.values[()] = outcome
        self._data.done.values[()], self._job = self._job, 0
        if self._data.go.get() != self._data.done.get():
            self._given()
