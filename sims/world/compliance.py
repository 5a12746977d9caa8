"""Joints that turn under gravity, to where the drives' torsion and the arm's weight hold each other there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from sims.world.masses import Body
from sims.world.screws import Axis, Vector
from sims.world.statics import GRAVITY_M_S2, Mass, levers, torques, turns

AT_REST_RAD = 1e-13
_MOST_ROUNDS = 60


class Falls(ArithmeticError):
    """The drives are too soft for what they carry: there is no pose near the commanded one in which it is held."""


@final
class Compliance:
    """Sag of every joint of one robot.

    `axes`: the true ones; `tcp`: the payload's place, at model zero, mm; `scale` multiplies what joints turn by;
    `down`: which way weight pulls, a unit vector in the base frame.
    """

    def __init__(
        self, body: Body, axes: Sequence[Axis], tcp: Vector, scale: float, down: Vector = (0.0, 0.0, -1.0)
    ) -> None:
        self._axes = tuple(axes)
        self._links = body.links
        self._tcp = tcp
        self._down = down
        self.rates = tuple(scale * rate for rate in body.compliance)
        """rad per N·mm."""

    def sagged(self, angles: Sequence[float], payload_kg: float = 0.0, at: Vector | None = None) -> list[float]:
        """Model angles (rad) at rest, of drives that stand at `angles`.

        The payload is `at` this place, at model zero in the base frame, mm; None: at the TCP.

        Torques are those of the sagged pose itself: each round takes them where the round before ended, and gains
        three digits on an arm of usual stiffness. Raises Falls.
        """
        links = self._loaded(payload_kg, at or self._tcp)
        here = list(angles)
        for _ in range(_MOST_ROUNDS):
            turned = turns(here)
            pulls = torques(self._axes, levers(self._axes, links, turned), turned, self._down)
            there = [angle + rate * pull for angle, rate, pull in zip(angles, self.rates, pulls, strict=True)]
            if max(abs(a - b) for a, b in zip(here, there, strict=True)) < AT_REST_RAD:
                return there
            here = there
        raise Falls("the joints are too soft for what they carry: the arm does not come to rest")

    def _loaded(self, payload_kg: float, at: Vector) -> Sequence[Mass]:
        if not payload_kg:
            return self._links
        payload = Mass(payload_kg * GRAVITY_M_S2, at)
        return *self._links[:-1], self._links[-1].together(payload)
