"""Whatever happens on the line, on-line correction never makes the controller's set-point leap: the whole responder.

The rule of the searches (test_kuka_leaps), with the same controller and the same faults: no step is larger than the
correction's rate allows, none beyond the correction's limit, and without faults no bend larger than its acceleration.
The program moves on its own, models are swapped, complete or torn, and the correction is ramped out and begun again.
"""

from __future__ import annotations

import math
import os
import random

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize, rule

from drivers.kuka_rsi.cyclic.limits import OnlineLimits
from drivers.kuka_rsi.cyclic.online_block import OnlineSlot, pack
from drivers.kuka_rsi.cyclic.online_correction import OnlineCorrection
from drivers.kuka_rsi.cyclic.session import Cause, InterpolationCycle, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import Slot
from tests.helpers.krc import CALM, HOME, ROUNDING, TIMEOUT, FaultyLine, Krc, Weather, wavy_model

SEQUENCES = int(os.environ.get("LEAP_SEQUENCES", "12"))
LIMITS = OnlineLimits()
CYCLES = {cycle.milliseconds: cycle for cycle in InterpolationCycle}
FASTEST_DEG_S = 100.0
MODELS = [pack(wavy_model(size)) for size in (0.0, 1.0, 30.0)]
"""Without an error; of a calibrated robot; and one that asks for far more than the limit."""

PLACES = [
    (30.0, *HOME[1:]),
    (*HOME[:4], 0.0, 0.0),
    (0.0, 0.0, 2.3, 0.0, 0.0, 0.0),
    (0.0, -90.0, 90.0, 180.0, 1e-3, 90.0),
]


class Corrected(Krc):
    """The controller while it runs its own program: `joints` are its program's, with the correction."""

    programmed: tuple[float, ...] = HOME
    velocity: tuple[float, ...] = (0.0,) * 6
    axis_text: str | None = None
    """Of all programmed joints, in place of their numbers; empty: a telegram without them."""

    def cycle(self) -> bool:
        share = self.cycle_ms / 1000
        self.programmed = tuple(at + share * by for at, by in zip(self.programmed, self.velocity, strict=True))
        self.zero = self.programmed
        return super().cycle()

    def telegram(self, ipoc: int | None = None) -> bytes:
        if self.axis_text == "":
            return super().telegram(ipoc)
        texts = [self.axis_text or f"{value:.{self.precision}f}" for value in self.programmed]
        axes = " ".join(f'A{i}="{text}"' for i, text in enumerate(texts, 1))
        return super().telegram(ipoc).replace(b"<IPOC>", f"<ASPos {axes}/><IPOC>".encode())


class Online(FaultyLine):
    """The driver's responder with an on-line correction, and the controller that runs its own program."""

    @initialize(
        cycle_ms=st.sampled_from([4, 12]), counts=st.sampled_from(["total", "reset"]), precision=st.sampled_from([1, 4])
    )
    def begin(self, cycle_ms: int, counts: str, precision: int) -> None:
        krc = Corrected(False, cycle_ms, counts, precision, ipoc=10**12)
        cycle = CYCLES[cycle_ms]
        self.connect(krc, lambda order: OnlineCorrection(order, LIMITS, self.block.online, TIMEOUT, cycle))
        self.block.online.place_model(MODELS[1])
        self.next_session()

    def next_session(self) -> None:
        """The last one is over; RSI is switched on anew where the program stands."""
        self.krc.velocity = (0.0,) * 6
        self.end_session()
        self.block.online.words[OnlineSlot.ORDER] = self.number
        self.block.place_order(SearchOrder(self.number, self.krc.joints, (0.0,) * 6, 1.0, (0,) * 8))
        self.block.announce_session(self.number)
        self.spell(75, Weather())

    def check(self, step_before: tuple[float, ...]) -> None:
        dt = self.krc.cycle_ms / 1000
        assert max(map(abs, self.krc.offset)) <= LIMITS.online_correction_deg + ROUNDING
        assert math.hypot(*self.step) <= LIMITS.online_rate_deg_s * dt + ROUNDING
        if self.calm > 3:
            assert math.dist(self.step, step_before) <= LIMITS.online_acceleration_deg_s2 * dt**2 + 2 * ROUNDING

    # what may happen

    @rule(seed=st.integers(0, 99), share=st.sampled_from([0.0, 0.1, 1.0]), then=st.sampled_from([5, 60, 200]))
    def the_program_goes_elsewhere(self, seed: int, share: float, then: int) -> None:
        """At up to 100 deg/s in each axis, also out of the measured region; a leap of its speed is none of ours."""
        draw = random.Random(seed)
        self.krc.velocity = tuple(share * draw.uniform(-FASTEST_DEG_S, FASTEST_DEG_S) for _ in range(6))
        self.spell(then, Weather())

    @rule(model=st.sampled_from(MODELS), torn=st.booleans(), then=CALM)
    def another_model(self, model: tuple[float, ...], torn: bool, then: int) -> None:
        online = self.block.online
        taken, version = online.status().taken, online.place_model(model)
        if torn:
            online.reals[OnlineSlot.HALVES + (version % 2) * (3 + 16_384) + 9] += 1.0
        self.spell(then, Weather())
        assert not torn or online.status().taken <= taken

    @rule(cycles=st.sampled_from([3, 30]), then=CALM)
    def another_model_in_every_cycle(self, cycles: int, then: int) -> None:
        for number in range(cycles):
            self.block.online.place_model(MODELS[number % 3])
            self.spell(1, Weather())
        self.spell(then, Weather())

    @rule(place=st.sampled_from(PLACES), then=st.sampled_from([1, 60]))
    def the_program_leaps(self, place: tuple[float, ...], then: int) -> None:
        """From one telegram to the next, also to where the wrist or the arm is singular: the correction does not."""
        self.krc.programmed, self.krc.velocity = place, (0.0,) * 6
        self.spell(then, Weather())

    @rule(text=st.sampled_from(["", "nan", "inf", "1e999", "4000.0"]), cycles=st.sampled_from([1, 40]))
    def no_programmed_joints(self, text: str, cycles: int) -> None:
        self.krc.axis_text = text
        self.spell(cycles, Weather())
        self.krc.axis_text = None
        self.spell(5, Weather())

    @rule(
        what=st.sampled_from(["ramp out", "stop", "ramp out and stop", "stall", "leap of the count"]),
        fading=st.sampled_from([0, 0, 1, 20]),
    )
    def an_end(self, what: str, fading: int) -> None:
        self.krc.velocity = (0.0,) * 6
        if fading:
            self.block.online.words[OnlineSlot.RAMP_OUT] = self.number
            self.spell(fading, Weather())
        match what:
            case "ramp out":
                self.block.online.words[OnlineSlot.RAMP_OUT] = self.number
            case "stop":
                self.block.words[Slot.STOP] = self.number
            case "ramp out and stop":
                self.block.online.words[OnlineSlot.RAMP_OUT] = self.block.words[Slot.STOP] = self.number
            case "stall":
                self.spell(TIMEOUT + 50, Weather(asleep=True))
            case _:
                self.krc.ipoc += 100_000
                self.calm = 0
        over = self.block.status().cause in (Cause.LOST, Cause.RESTARTED)  # by a count that was off before
        lost = over or what in ("stall", "leap of the count") or not self.krc.on
        self.spell(1, Weather())
        held = self.krc.offset
        self.spell(500, Weather())
        if what == "ramp out" and not lost:
            assert max(map(abs, self.krc.offset)) <= 1e-6
        assert not lost or self.krc.offset == held
        self.next_session()


Online.TestCase.settings = settings(
    max_examples=SEQUENCES, stateful_step_count=12, derandomize=True, deadline=None, print_blob=True
)
TestNoCorrectionMakesTheRobotLeap = Online.TestCase
